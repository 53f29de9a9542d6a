"""The displacement between two lines: search, refinement and variance."""
