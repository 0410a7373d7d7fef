"""Synthetic photographs of procedural furniture, with exact truth."""
