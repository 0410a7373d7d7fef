"""Readers of USD, STEP, IGES and FBX files for mam-sim, found by their entry points."""
