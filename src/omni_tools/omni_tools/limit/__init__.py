"""Shortest possible stops, computed by optimization, and the command for bounds and stops."""
