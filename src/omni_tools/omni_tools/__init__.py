"""Computations behind the commands of a user: limit, placement, fits, reports."""
