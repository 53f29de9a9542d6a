"""Functions shared by the studies of section 3.6."""
