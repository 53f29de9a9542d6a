"""Simulated line cameras that move over a ground, and the errors of their measurements."""
