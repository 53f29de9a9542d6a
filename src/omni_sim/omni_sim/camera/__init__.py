"""Line cameras: when they expose, what of the ground reaches each pixel, noise."""
