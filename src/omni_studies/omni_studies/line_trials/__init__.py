"""Trials of line cameras over grounds, and their errors."""
