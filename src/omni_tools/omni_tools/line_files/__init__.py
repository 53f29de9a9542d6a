"""Lines of real cameras in files, and figures of a camera's lines."""
