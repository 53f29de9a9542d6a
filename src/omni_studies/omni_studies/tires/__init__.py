"""Trials, fits and figures of tires."""
