"""Lines of real cameras in files, and the picture of what a camera saw."""
