"""Starts the process of the player with few imports, so that signals are handled early."""

from omni_ros.start import start_node


def main() -> None:
    """Run the node until its end, SIGINT or SIGTERM."""
    start_node("omni_bringup.replay.player_node")
