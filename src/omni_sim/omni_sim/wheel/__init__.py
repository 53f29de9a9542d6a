"""One wheel: hub, drive, brake, and either individual rollers or a single roller."""
