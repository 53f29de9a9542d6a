"""One wheel: hub, drive, brake, and rollers, modeled individually or as a single roller."""
