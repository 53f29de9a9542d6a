"""Body twist from velocities along sensor axes, and pose by integration."""
