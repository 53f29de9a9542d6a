"""Replay of recorded inputs through the cores of the nodes."""
