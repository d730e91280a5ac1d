"""Models of reflection, one a file, and the material that joins them."""
