"""Detection of occluded cameras, and of oblique textures in the view of a camera."""
