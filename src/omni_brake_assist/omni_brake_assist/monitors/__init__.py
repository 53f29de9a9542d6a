"""Monitors, one module each, that put all brakes on or withhold implausible inputs from a law."""
