"""Empirical tire models: force as a function of slip and load, and the contact equation."""
