"""Replay of recorded inputs through the nodes, or through the cores of the nodes."""
