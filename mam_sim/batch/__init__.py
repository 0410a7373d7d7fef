"""Many inputs, one command: assets made side by side, resumable, with guards for each object."""
