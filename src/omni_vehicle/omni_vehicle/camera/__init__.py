"""Conversion of frames of real cameras to batches of lines."""
