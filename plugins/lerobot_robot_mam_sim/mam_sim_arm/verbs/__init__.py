"""One module per command-line verb; heavy imports happen inside the verb."""
