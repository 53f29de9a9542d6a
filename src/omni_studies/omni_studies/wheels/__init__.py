"""Trials and figures that compare wheel models, and their computing time."""
