"""Line cameras: exposure times, mean gray level of each pixel's footprint, noise."""
