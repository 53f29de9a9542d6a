"""Tire models fitted to measured forces."""
