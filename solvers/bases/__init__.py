"""Bases of functions on a normalised interval and their matrices; NumPy and SciPy only."""
