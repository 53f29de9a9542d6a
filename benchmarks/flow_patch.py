"""Compare a patch of 64 x 64 pixels with a line of 1024 at the same number of pixels per second.

Both see 50 mm of the ground along the axis. The line camera takes 2500 lines/s of 20 mm width, and
the square patch 625 frames/s. Each measures for 10 ms. The whole odometry of one camera processes a
batch of lines. OpenCV's phase correlation and Lucas-Kanade process seven frames of the patch:
consecutive frames in fast motion, else the first and the last frame. The benchmark reports the
error of the velocity along the axis.

    ./omni exec python -m pip install --no-deps --require-hashes -r requirements/opencv.lock
    ./omni exec python benchmarks/flow_patch.py [--json] [--runs N]
"""

import importlib
import itertools
import math
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import output
from numpy.typing import NDArray

from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.sensor import SensorOdometry
from omni_platform.sensors import LineSensor
from omni_sim.texture.texture import GroundTexture
from omni_tools.line_trials.rig import Rig, ground, poses_at

GROUNDS = ("asphalt", "worn_asphalt", "concrete", "gravel", "brick")
SPEEDS = (0.05, 0.2, 1.0, 3.0, 10.0)  # [m/s]
ANGLES = (0.0, 45.0)  # from the axis to the motion [deg]
EYE = LineSensor(x=0.0, y=0.0, heading_deg=0.0)
OTHERS = {"a": replace(EYE, y=0.5), "b": replace(EYE, x=0.6, heading_deg=90.0)}
PIXELS, FRAMES = 64, 7
FRAME_RATE = EYE.pixels * EYE.line_rate / PIXELS**2
NOISE = 1.0  # standard deviation [gray levels]

Frame = NDArray[np.float32]


def line_error(texture: GroundTexture, velocity: Any, seed: int) -> float:
    """Return the velocity error of one batch [m/s], NaN if the batch is not measured."""
    generator = np.random.default_rng(seed)
    start = np.append(generator.uniform(0.0, texture.size, 2), generator.uniform(0.0, 6.0))
    rig = Rig({"eye": EYE}, texture, NOISE, seed)
    odometry = SensorOdometry(EYE, OdometryConfiguration(sensors={"eye": EYE, **OTHERS}))
    twist = np.append(velocity, 0.0)
    for batch in rig.drive(start, twist, 3):  # the last batch counts
        reading = odometry.update(batch["eye"])
    return reading.velocity - float(velocity[0]) if reading.measured else math.nan


def patch_error(cv2: Any, texture: GroundTexture, velocity: Any, seed: int) -> float:
    """Return the velocity error of seven frames [m/s]."""
    generator = np.random.default_rng(seed)
    start = np.append(generator.uniform(0.0, texture.size, 2), generator.uniform(0.0, 6.0))
    elapsed = np.arange(FRAMES) / FRAME_RATE
    frames = [
        patch(cv2, texture, pose, generator)
        for pose in poses_at(elapsed, start, np.append(velocity, 0.0))
    ]
    steps = [displacement(cv2, old, new) for old, new in itertools.pairwise(frames)]
    shift = float(np.median(steps))
    if abs(shift) * (FRAMES - 1) < 0.375 * PIXELS:  # the first and the last frame overlap
        shift = displacement(cv2, frames[0], frames[-1]) / (FRAMES - 1)
    return shift * FRAME_RATE * EYE.length / PIXELS - float(velocity[0])


def displacement(cv2: Any, old: Frame, new: Frame) -> float:
    """Return the displacement along the axis [px] by phase correlation, then Lucas-Kanade."""
    window = cv2.createHanningWindow((PIXELS, PIXELS), cv2.CV_32F)
    # Copies, because OpenCV multiplies its arguments by the window.
    d = np.array(cv2.phaseCorrelate(old.copy(), new.copy(), window)[0])
    first, second = (cv2.GaussianBlur(frame, (0, 0), 0.8) for frame in (old, new))
    for _ in range(5):
        matrix = np.array([[1.0, 0.0, -d[0]], [0.0, 1.0, -d[1]]])
        moved = cv2.warpAffine(second, matrix, (PIXELS, PIXELS), flags=cv2.INTER_CUBIC)
        edge = int(np.ceil(np.abs(d).max())) + 3
        if 2 * edge > PIXELS - 8:
            break
        inner = (slice(edge, -edge), slice(edge, -edge))
        slope_y, slope_x = np.gradient(0.5 * (first + moved))
        slopes = np.stack((slope_x[inner].ravel(), slope_y[inner].ravel()))
        d = d + np.linalg.solve(slopes @ slopes.T, slopes @ (first - moved)[inner].ravel())
    return -float(d[0])


def patch(cv2: Any, texture: GroundTexture, pose: Any, generator: np.random.Generator) -> Frame:
    """Return the noisy picture of the area camera at a pose, with columns along its axis."""
    fine = 8  # samples of the ground per pixel and direction
    count = PIXELS * fine
    place = ((np.arange(count) + 0.5) / count - 0.5) * EYE.length
    along, across = np.meshgrid(place, place)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x = (pose[0] + c * along - s * across) / texture.texel - 0.5
    y = (pose[1] + s * along + c * across) / texture.texel - 0.5
    n = len(texture.gray)
    seen = cv2.remap(
        texture.gray, (x % n).astype(np.float32), (y % n).astype(np.float32), cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_WRAP,
    )  # fmt: skip
    mean = seen.reshape(PIXELS, fine, PIXELS, fine).mean(axis=(1, 3))
    noisy = np.rint(mean + generator.normal(0.0, NOISE, mean.shape))
    return np.asarray(noisy.clip(0, 255), np.float32)


def main() -> int:
    """Compare, print the table or the document."""
    options = output.options(__doc__, runs=12)
    try:
        cv2: Any = importlib.import_module("cv2")
    except ImportError:
        print("needs OpenCV: see the head of this file", file=sys.stderr)
        return 2
    cv2.setNumThreads(1)
    metrics: output.Metrics = {}
    for kind in GROUNDS:
        texture = ground(kind)
        for angle in ANGLES:
            for speed in SPEEDS:
                turn = math.radians(angle)
                velocity = speed * np.array([math.cos(turn), math.sin(turn)])
                seeds = range(1, options.runs + 1)
                lines = np.array([line_error(texture, velocity, seed) for seed in seeds])
                flow = np.array([patch_error(cv2, texture, velocity, seed) for seed in seeds])
                measured = lines[np.isfinite(lines)]
                case = f"{kind}_{angle:.0f}_{speed:g}"
                metrics[f"patch_rmse.{case}"] = math.sqrt(float(np.mean(flow**2))), "m/s"
                if len(measured):
                    metrics[f"line_rmse.{case}"] = math.sqrt(float(np.mean(measured**2))), "m/s"
                metrics[f"line_measured.{case}"] = len(measured) / len(lines), "1"
    output.publish("flow_patch", metrics, as_json=options.json)
    return 0


if __name__ == "__main__":
    sys.exit(main())
