"""Frames of real cameras to batches of lines."""
