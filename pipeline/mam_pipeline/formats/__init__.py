"""Readers and writers of mesh file formats whose appearance must survive untouched."""
