"""Line cameras moved over a ground, and what is measured from their lines."""
