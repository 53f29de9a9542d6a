"""Textures of the ground: procedural materials, or a user's pictures."""
