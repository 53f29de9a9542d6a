"""Start, recording and shutdown of the nodes, and the command line."""
