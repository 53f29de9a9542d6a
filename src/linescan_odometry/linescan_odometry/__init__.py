"""Body twist from one-dimensional line cameras and its ROS node."""
