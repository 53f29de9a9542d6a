"""Odometry that measures the body twist with one-dimensional line cameras, and its ROS node."""
