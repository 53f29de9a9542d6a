"""Processes of a run: nodes, their ROS domain, start and shutdown."""
