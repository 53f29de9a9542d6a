"""Computations of the commands: stopping limits, sensor placement, parameter fits and reports."""
