"""One photograph of a closed, box-like object to a textured mesh with named parts: no weights."""
