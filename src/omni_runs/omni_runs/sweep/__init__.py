"""Runs of an experiment with several values of its parameters."""
