"""Simulated line cameras that move over a ground, and errors of their measurements."""
