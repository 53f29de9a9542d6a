"""Drivers of the vehicle: a script, or commands from outside."""
