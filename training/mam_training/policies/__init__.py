"""Trains policies that come with mam-sim."""
