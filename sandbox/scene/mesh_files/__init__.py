"""Readers of mesh files, one a format: what stands in the file, not yet looked at. NumPy only."""
