"""Detection of cameras that are occluded or over an oblique texture."""
