"""Drivers of the vehicle: a script, or commands from another node."""
