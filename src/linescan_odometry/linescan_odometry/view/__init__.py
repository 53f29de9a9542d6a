"""Fixed patterns, occlusion and oblique textures in the view of a camera."""
