"""Installs omni_runs as an ament_python package."""

import sys

sys.path.insert(0, "../omni_core")
from ament_package import install

install(
    commands={
        "replay": "omni_runs.replay.command",
        "run": "omni_runs.run.command",
    },
    data=["figures/omni.mplstyle"],
)
