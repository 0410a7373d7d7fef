"""Foundation models as backends: each runs in its own process or behind HTTP, never imported."""
