"""The command ``./omni run``: an experiment over the ROS graph, or with several values."""
