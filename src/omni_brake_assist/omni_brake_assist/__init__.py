"""Brake assistant for omnidirectional vehicles, and its ROS node."""
