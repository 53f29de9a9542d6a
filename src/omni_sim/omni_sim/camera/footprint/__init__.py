"""The mean of a texture over the rotated footprint of each pixel."""
