"""Empirical tire models: force over slip and load, and the contact equation."""
