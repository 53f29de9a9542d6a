"""The look of the ground, procedural or from a picture."""
