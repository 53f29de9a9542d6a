"""Warming up loads every kernel, so that no later update waits for one."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from linescan_odometry.configuration import METHODS

_PROGRAM = """
import sys
import numpy as np
from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.odometry import LineScanOdometry
from omni_core.compilation.cache import KernelCache
from omni_core.sensors import LineSensor
from omni_core.signals import LineBatch

kept, found = KernelCache.load_overload, []
def load(cache, *arguments):
    found.append(cache.dispatcher.py_func.__qualname__)
    return kept(cache, *arguments)
KernelCache.load_overload = load

placement = {"front": (0.6, 0.0, 90.0), "left": (0.0, 0.6, 180.0), "right": (0.0, -0.6, 0.0)}
sensors = {
    name: LineSensor(x=x, y=y, heading_deg=h, pixels=256, length=0.0128, line_rate=2500.0)
    for name, (x, y, h) in placement.items()
}
configuration = OdometryConfiguration(sensors=sensors, method=sys.argv[1])
LineScanOdometry(configuration).warm_up()
assert found
found.clear()
for file in sys.argv[2:]:
    odometry, lines = LineScanOdometry(configuration), np.load(file)
    for newest in range(25, len(lines) + 1, 25):
        batch = LineBatch(newest * 400_000, lines[newest - 25 : newest])
        odometry.update(dict.fromkeys(sensors, batch))
print(*sorted(found))
"""


@pytest.mark.parametrize("method", METHODS)
def test_no_kernel_is_loaded_after_warming_up(
    expose: Callable[..., Any], tmp_path: Path, method: str
) -> None:
    moving = 7.3 * np.arange(75)
    stopping = moving[-1] + np.cumsum(np.linspace(7.3, 0.0, 75))
    at_rest = np.full(50, stopping[-1])
    positions = np.concatenate([moving, stopping, at_rest])
    files = [tmp_path / "8_bit.npy", tmp_path / "16_bit.npy"]
    for file, dtype in zip(files, (np.uint8, np.uint16), strict=True):
        np.save(file, expose(positions, 256, noise=2.0, dtype=dtype))
    arguments = [sys.executable, "-c", _PROGRAM, method, *map(str, files)]
    done = subprocess.run(arguments, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == []
