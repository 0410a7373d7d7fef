"""What is known of an object beside its geometry: words, the file's nodes, its animation."""
