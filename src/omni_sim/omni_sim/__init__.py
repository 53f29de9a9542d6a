"""Tire, wheel, vehicle, ground and line-camera simulation and its ROS node."""
