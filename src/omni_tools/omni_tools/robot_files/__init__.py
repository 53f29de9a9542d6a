"""A vehicle from the files of a robot: URDF, xacro and parameters of ros2_control."""
