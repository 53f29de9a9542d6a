"""Trials and figures that compare wheels, and what they cost."""
