"""Trials that compare wheel models, and their computing time."""
