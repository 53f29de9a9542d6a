"""The processes of a run: nodes, their domain, start and stop."""
