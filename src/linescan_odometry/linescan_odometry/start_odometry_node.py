"""Starts the process of the odometry with few imports, so that signals are handled early."""

from omni_ros.start import start_node


def main() -> None:
    """Run the node until its end, SIGINT or SIGTERM."""
    start_node("linescan_odometry.odometry_node")
