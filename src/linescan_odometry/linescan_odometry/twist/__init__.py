"""From velocities along sensor axes to the body twist, and on to a pose."""
