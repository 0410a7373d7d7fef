"""Foundation models and hosted services as backends of mam-sim, found by their entry points."""
