"""Textures of the ground, procedural or from a picture."""
