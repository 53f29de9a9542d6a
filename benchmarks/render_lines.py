"""Measure the line-camera renderer: throughput, accuracy and memory.

Run it on an otherwise idle machine, with the workspace's packages on the path:

    python benchmarks/render_lines.py [--json] [--ground cork] [--texels 4096 | --dpi 2400]

Errors are relative to the exact integral over the ground at its full resolution. The peak memory is
that of a separate process, which loads a ground of 2400 dpi from the cache, sets up cameras and
rotates them by 360 deg. The first run generates the ground in the cache.
"""

import math
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import output
from numpy.typing import NDArray

from omni_core.sensors import LineSensor
from omni_sim.camera.camera import LineCameraArray
from omni_sim.camera.configuration import CameraConfiguration
from omni_sim.texture.cache import TextureCache
from omni_sim.texture.configuration import KINDS, TextureConfiguration
from omni_sim.texture.texture import GroundTexture, generate_texture

HEADINGS_DEG = (0, 0.05, 1, 5, 20, 33, 45, 90, 133, 200, 300)
SENSORS = {name: output.camera(name) for name in ("generic", "lis_770i", "s3901")}
LIMITS = {"generic": ((15e3,), (0.15,)), "s3901": ((100e3,), (0.15,))}
"""Minimum rate [lines/s] and maximum error [gray levels], keyed by the kind of camera."""
SPEED = 10.0  # [m/s]


def path(count: int, heading: float, turn: float) -> NDArray[np.float64]:
    """Return the poses x, y, yaw [m, m, rad] of `count` lines at 2500 lines/s, shape (count, 3).

    The velocity is 10 m/s along x and 1 m/s along y.

    Args:
        count: number of lines.
        heading: yaw at the first line [rad].
        turn: yaw rate [rad/s].
    """
    elapsed = np.arange(count) / 2500.0
    return np.column_stack((SPEED * elapsed, 0.1 * SPEED * elapsed, heading + turn * elapsed))


def throughput(
    sensor: LineSensor, texture: GroundTexture, heading: float, lines: int = 200
) -> tuple[float, float]:
    """Return the rendered lines per second of CPU time, and their RMS error [gray levels]."""
    seed = np.random.SeedSequence(1)
    array = LineCameraArray({"one": sensor}, texture, CameraConfiguration(), seed)
    poses = path(lines, heading, 0.0)
    array.render({"one": poses})
    best = output.fastest(lambda: array.render({"one": poses}), 15)
    camera = array.cameras["one"]
    sys.path.append(str(Path(__file__).resolve().parents[1] / "tests"))
    from exact_footprint import integrate_exactly

    picked = poses[:: lines // 3]
    errors = [
        gray
        - integrate_exactly(
            texture.gray, texture.size, tuple(center), sensor.length, sensor.width, sensor.pixels
        )
        for gray, center in zip(camera.grays(picked), camera.footprints(picked), strict=True)
    ]
    return lines / best, float(np.sqrt(np.mean(np.square(errors))))


def turn_around(kind: str, names: list[str]) -> float:
    """Render a turn of 360 deg over a ground of 2400 dpi; return the process's peak memory [GB]."""
    texture = TextureCache.of_user().texture(TextureConfiguration(kind=kind, dpi=2400.0))
    sensors = {name: SENSORS[name] for name in names}
    array = LineCameraArray(sensors, texture, CameraConfiguration(), np.random.SeedSequence(1))
    array.render(dict.fromkeys(sensors, path(720, 0.0, math.radians(0.5) * 2500.0)))
    with open("/proc/self/status", encoding="ascii") as status:
        peak = next(line for line in status if line.startswith("VmHWM:"))
    return int(peak.split()[1]) * 1024e-9


def peak_memory(kind: str, names: list[str]) -> float:
    """Return the peak memory of a new process that only runs `turn_around` [GB]."""
    command = [sys.executable, __file__, "--ground", kind, "--turn-around", ",".join(names)]
    for _ in range(2):  # the first process generates the ground and compiles, if necessary
        done = subprocess.run(command, check=True, capture_output=True, text=True)
    return float(done.stdout)


def measure(kind: str, texels: int, dpi: float) -> output.Metrics:
    """Return all metrics, keyed by name."""
    metrics: output.Metrics = {}
    for name in KINDS:  # a small first measurement compiles the kernels
        generate_texture(TextureConfiguration(kind=name, texels=256))
        start = time.perf_counter()
        generate_texture(TextureConfiguration(kind=name, texels=texels))
        metrics[f"generation.{name}"] = time.perf_counter() - start, "s", 3.0
    texture = generate_texture(TextureConfiguration(kind=kind, texels=texels, dpi=dpi))
    for name, sensor in SENSORS.items():
        for heading in HEADINGS_DEG:
            rate, error = throughput(sensor, texture, math.radians(heading))
            least, largest = LIMITS.get(name, ((), ()))
            metrics[f"throughput.{name}_{heading}_deg"] = rate, "1/s", *least
            metrics[f"rms_error.{name}_{heading}_deg"] = error, "1", *largest
    for names in (["generic"], ["lis_770i"], ["s3901"], list(SENSORS)):
        case = names[0] if len(names) == 1 else "all_three"
        metrics[f"peak_memory.{case}"] = peak_memory(kind, names), "GB", 1.0
    return metrics


def main() -> None:
    """Measure and print all metrics."""
    options = output.options(__doc__, ground="cork", texels=4096, dpi=0.0, turn_around="")
    if options.turn_around:
        print(turn_around(options.ground, options.turn_around.split(",")))
        return
    metrics = measure(options.ground, options.texels, options.dpi)
    output.publish("render_lines", metrics, as_json=options.json)


if __name__ == "__main__":
    main()
