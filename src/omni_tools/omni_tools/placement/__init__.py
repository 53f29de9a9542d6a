"""Placement of line cameras for the most accurate twist."""
