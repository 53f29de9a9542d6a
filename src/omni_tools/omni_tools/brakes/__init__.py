"""The torque, dead time and lag of a vehicle's own brakes, from its recorded stops."""
