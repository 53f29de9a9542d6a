"""Compile every kernel and make the ground of the standard experiment, so that no run waits.

Started by the launcher after a build; the results are in the caches on disk.
"""

from __future__ import annotations

import dataclasses
import os
import pickle
import sys
from pathlib import Path

from omni_analysis.loop.compiled import run_fast_loop
from omni_analysis.loop.experiment import ExperimentLibrary
from omni_analysis.loop.loop import run_closed_loop
from omni_bringup.cli import workspace

_EXPERIMENT = "straight_line"
_DURATION = 0.1  # [s] simulated; long enough to brake


def warm_up(folder: Path) -> None:
    """Run a moment of the standard experiment in this process.

    Args:
        folder: the workspace, with its `config`.
    """
    library = ExperimentLibrary(folder / "config")
    variant = library.variants(_EXPERIMENT)[-1]
    configuration = library.load(
        _EXPERIMENT,
        variant,
        (f"simulation.duration_limit={_DURATION}", f"maneuver.brake_time={_DURATION / 2}"),
    )
    run_closed_loop(configuration)
    # Lines of 16 bits take other kernels.
    deep = dataclasses.replace(configuration.camera, bit_depth=16)
    run_closed_loop(dataclasses.replace(configuration, camera=deep))
    run_fast_loop(dataclasses.replace(configuration, feedback="velocity_sensor"))


def forget_lost_types(cache: Path) -> None:
    """Delete the indices of kernels that were compiled for a type that has been moved or renamed.

    numba cannot read them any more, and gives up instead of compiling anew.

    Args:
        cache: folder of compiled kernels.
    """
    for index in cache.glob("*/*.nbi"):
        with index.open("rb") as file:
            try:
                pickle.load(file)  # numba's version
                pickle.load(file)
            except (ImportError, AttributeError):
                index.unlink()


if __name__ == "__main__":
    forget_lost_types(Path(os.environ["NUMBA_CACHE_DIR"]))
    warm_up(workspace())
    sys.exit(0)
