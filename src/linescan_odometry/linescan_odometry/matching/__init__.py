"""Displacement between two lines: search, refinement and variance."""
