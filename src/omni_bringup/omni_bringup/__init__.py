"""Command line of the project, and start, recording and shutdown of the nodes."""
