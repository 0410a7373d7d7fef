"""A network that tells from one camera's picture where the object stands and how far it is open."""
