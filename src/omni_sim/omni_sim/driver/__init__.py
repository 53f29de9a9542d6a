"""Drivers of the simulated vehicle: a script, or commands from another node."""
