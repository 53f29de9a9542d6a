"""Replay of recorded inputs through the nodes or their cores."""
