"""Torque, dead time and lag of a vehicle's brakes from recorded stops."""
