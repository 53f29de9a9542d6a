"""Certified lower bounds of the stopping distance from forces, loads and friction."""
