"""Abstract training objects whose truth is known: wider than any category of the world."""
