"""Trials of line cameras over grounds, their errors and figures."""
