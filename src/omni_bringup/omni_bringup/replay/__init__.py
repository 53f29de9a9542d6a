"""Recorded inputs through the nodes, or their cores, once more."""
