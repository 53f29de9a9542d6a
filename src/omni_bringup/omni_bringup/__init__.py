"""Starts, records and stops the nodes; the command line."""
