"""One wheel: hub, drive, brake, and its rollers, individual or modeled as one."""
