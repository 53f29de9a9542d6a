"""The environment that a node process runs in; needs no ROS to be imported."""

from __future__ import annotations

import os
from pathlib import Path

# The process whose death ends the node; set by whoever starts a graph.
PARENT_PID_VARIABLE = "OMNI_PARENT_PID"
# The file descriptor that a node reports to; set by whoever started it and reads there.
REPORT_VARIABLE = "OMNI_REPORT_FD"

_PROFILE = Path(__file__).with_name("fastdds_profile.xml")


def node_environment(domain: int) -> dict[str, str]:
    """Return this process's environment, made fit for the nodes of a local graph.

    What the user has set stays: the domain, the discovery range and the DDS profile.

    Args:
        domain: ROS domain of the graph.
    """
    environment = dict(os.environ)
    environment.setdefault("ROS_DOMAIN_ID", str(domain))
    environment.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    environment.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(_PROFILE))
    environment.setdefault("PYTHONUNBUFFERED", "1")
    return environment
