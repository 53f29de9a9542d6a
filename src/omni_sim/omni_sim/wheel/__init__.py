"""One wheel: hub, drive, brake, and its rollers, modeled individually or as one."""
