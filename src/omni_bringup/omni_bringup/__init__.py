"""Command line of the project, and start, recording and shutdown of the nodes."""

from omni_ros.start import start_lightly

start_lightly()  # before any module of this package imports numpy
