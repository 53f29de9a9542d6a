"""Simulation of tires, wheels, vehicle, ground and line cameras, and its ROS node."""
