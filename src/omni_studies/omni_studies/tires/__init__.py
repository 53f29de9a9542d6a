"""Trials of tires under a vehicle."""
