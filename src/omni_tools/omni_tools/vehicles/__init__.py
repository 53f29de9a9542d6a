"""Estimates, checks and drawings of vehicles."""
