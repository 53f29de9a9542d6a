"""Adapters between the nodes and the brakes, drives and flow sensors of a real vehicle."""
