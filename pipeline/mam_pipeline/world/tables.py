"""Empty."""
CATEGORIES: dict = {}
