"""Sliding-mode brake assistant for omnidirectional vehicles and its ROS node."""
