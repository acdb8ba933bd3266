"""Spatial mechanisms without natural coordinates, for the tests to compare with: NumPy, rotations and closed forms."""
