"""Mean of a texture over the rotated footprint of each pixel."""
