"""One wheel: hub, drive, brake, and its rollers, each of its own or as one."""
