"""Geometry and kinematics of omnidirectional platforms."""
