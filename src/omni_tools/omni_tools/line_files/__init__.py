"""Lines of real cameras in files, calibration of cameras, and figures of lines."""
