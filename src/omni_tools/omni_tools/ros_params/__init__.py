"""Parameter files for the nodes on a real vehicle."""
