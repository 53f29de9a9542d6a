"""Computations behind the commands: limit, placement, fits, reports."""
