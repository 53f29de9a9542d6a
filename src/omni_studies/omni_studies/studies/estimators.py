"""Comparison of velocity estimators for a line camera and for an optical-flow sensor.

A camera with 1024 px and 2500 lines/s records batches of 10 ms. Both methods of the odometry
(parameter ``odometry.method``) process the same lines, with and without camera faults. With OpenCV
(``requirements/opencv.lock``), two alternatives measure the same motion: phase correlation of
consecutive lines of the camera, and an optical-flow sensor with images of 64 x 64 px and the same
number of pixels per second. Its images are evaluated by phase correlation and then by
Lucas-Kanade. All errors are errors of the velocity along the camera's axis. The Cramer-Rao bound is
valid for a batch in motion along the axis.
"""

from __future__ import annotations

import importlib
import itertools
import math
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from linescan_odometry.configuration import METHODS
from omni_core.configuration import Configuration, parameter
from omni_core.quantities import Float32Array, FloatArray
from omni_runs.figures import style
from omni_runs.metrics import Metric
from omni_sim.camera.configuration import CameraConfiguration
from omni_sim.texture.texture import GroundTexture
from omni_studies.line_trials import integrity_cases as cases
from omni_studies.line_trials import integrity_trials as trials
from omni_studies.study import StudyResult, StudyRun
from omni_tools.line_trials.rig import Rig, View, batch_lines, poses_at
from omni_tools.line_trials.trials import cramer_rao_bound

_GROUNDS = ("asphalt", "worn_asphalt", "concrete", "gravel", "brick")
_SPEEDS = (0.05, 0.2, 1.0, 3.0, 10.0)  # m/s
_ANGLES = (0, 45)  # from the axis to the motion [deg]
_FAULTS = ("none", "dirt_spots", "prnu", "mud")
_BATCHES = 3  # number of batches per motion
_OTHERS = ("phase", "patch")  # estimators that require OpenCV

_EYE = cases.SENSORS["left"]
_SCALE = _EYE.pixel_pitch * _EYE.line_rate  # velocity per displacement between lines [m/s per px]
_NOISE = CameraConfiguration().noise  # gray levels
_PIXELS, _FRAMES = 64, 7  # pixels along an edge of the patch, and frames per batch
_FRAME_RATE = _EYE.pixels * _EYE.line_rate / _PIXELS**2
_FINE = 8  # ground samples per pixel of the patch, in each direction
_SMOOTH, _ROUNDS = 0.8, 5  # Lucas-Kanade: standard deviation of the Gaussian [px], iterations
_SPANNED = 24.0  # limit on the displacement up to which first and last frame are compared [px]


class Scene(NamedTuple):
    """A line camera, the ground, and the pose of the platform (x, y [m], yaw [rad])."""

    texture: GroundTexture
    rig: Rig
    start: FloatArray

    @classmethod
    def of(cls, kind: str, seed: int, number: int) -> Scene:
        """Return a scene with a random pose of the camera.

        Args:
            kind: kind of the ground.
            seed: seed of all scenes.
            number: number of the scene; each scene has another pose.
        """
        texture = trials.Ground(kind).texture()
        generator = np.random.default_rng((seed, number))
        start = np.append(generator.uniform(0.0, texture.size, 2), generator.uniform(0.0, 6.0))
        return cls(texture, Rig({"eye": _EYE}, texture, _NOISE, seed), start)


class Options(Configuration):
    """Options of the study ``estimators``: number of motions, and seed."""

    runs: int = parameter(4, minimum=1, maximum=1000)
    """number of motions from random positions for each ground, speed and angle"""
    seed: int = parameter(1, minimum=0)
    """seed of positions and noise"""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Simulate the motions over every ground; write figure, data and metrics."""
    cells = list(itertools.product(_GROUNDS, _ANGLES, _SPEEDS))
    rows, metrics = [], {}
    bounds: dict[str, list[float]] = {}
    for number, (kind, angle, speed) in enumerate(cells):
        study.report(number / len(cells), f"{kind}, {angle} deg, {speed:g} m/s")
        case = f"{kind}_{angle}_{speed:g}".replace(".", "_")
        errors = errors_of(kind, math.radians(angle), speed, options)
        bound = batch_bound(kind, speed, options) if angle == 0 else math.nan
        for (estimator, fault), error in errors.items():
            key = case if fault == "none" else f"{case}_{fault}"
            measured = error[np.isfinite(error)]
            rmse = 1e3 * math.sqrt(float(np.mean(measured**2))) if len(measured) else math.nan
            available = 100.0 * len(measured) / len(error)
            metrics[f"{estimator}_rmse.{key}"] = Metric(rmse, "mm/s")
            metrics[f"{estimator}_available.{key}"] = Metric(available, "%")
            if fault == "none":
                rows.append((estimator, kind, angle, speed, rmse, bound))
            if fault == "none" and angle == 0:
                bounds.setdefault(estimator, []).append(rmse / bound)
    for estimator, ratios in bounds.items():
        metrics[f"rmse_over_bound.{estimator}"] = Metric(float(np.nanmedian(ratios)), "1")
    study.plot("estimators", _draw(rows))
    return study.result(metrics)


def errors_of(
    kind: str, angle: float, speed: float, options: Options
) -> dict[tuple[str, str], FloatArray]:
    """Return velocity errors along the camera's axis [m/s], keyed by estimator and fault.

    Each array has the error of every batch, shape (batches,); NaN if the batch is unmeasured.

    Args:
        kind: kind of ground.
        angle: angle between motion and camera axis [rad].
        speed: speed of the motion [m/s].
        options: number of motions, and seed.
    """
    velocity = speed * np.array([math.cos(angle), math.sin(angle)])
    motion = cases.PathMotion((float(velocity[0]), float(velocity[1]), 0.0))
    errors = {}
    for method in METHODS:
        faults = {fault: cases.FAULTS[fault] for fault in _FAULTS}
        tallies = trials.drive_over(
            trials.Ground(kind), faults, range(options.runs), _BATCHES, options.seed,
            motions=(motion,), method=method,
        )  # fmt: skip
        for fault, tally in tallies.items():
            error = np.where(np.isfinite(tally.ratio), tally.error, np.nan)
            errors[method, fault] = error[:: len(cases.SENSORS)]  # only the first camera
    try:
        cv2: Any = importlib.import_module("cv2")
    except ImportError:
        return errors
    cv2.setNumThreads(1)
    for name, estimate in zip(_OTHERS, (_phase, _patch), strict=True):
        found = []
        for run_number in range(options.runs):
            scene = Scene.of(kind, options.seed, run_number)
            found.append(estimate(cv2, scene, np.append(velocity, 0.0)) - velocity[0])
        errors[name, "none"] = np.array(found)
    return errors


def batch_bound(kind: str, speed: float, options: Options) -> float:
    """Return the Cramer-Rao bound of the velocity from one batch, as a standard deviation [mm/s].

    A point of the ground that appears in K consecutive lines contributes the information of one
    pixel on a known ground, multiplied by K (K^2 - 1) / 12. This factor is the sum of the squared
    differences between the times of the K lines and their mean, in line periods.
    """
    _, rig, start = Scene.of(kind, options.seed, 0)
    lines, shift = batch_lines(_EYE.line_rate) + 1, speed / _SCALE
    camera = rig.array.cameras["eye"]
    pair = cramer_rao_bound(View.of(_EYE), camera, start[None], np.zeros(1), _NOISE)[0]
    point = np.arange(math.ceil(_EYE.pixels + (lines - 1) * shift))
    first = np.ceil(np.maximum(0.0, (point - _EYE.pixels + 1) / shift))
    seen = np.minimum(lines - 1, np.floor(point / shift)) - first + 1
    information = 2.0 / pair * np.sum(seen * (seen**2 - 1.0)) / 12.0 / _EYE.pixels
    return 1e3 * _SCALE / math.sqrt(float(information))


def _phase(cv2: Any, scene: Scene, twist: FloatArray) -> float:
    """Return the velocity from the phase correlation of consecutive lines [m/s]."""
    (batch,) = scene.rig.drive(scene.start, twist, 1)
    lines = batch["eye"].lines.astype(np.float32)[:, None]
    window = np.hanning(_EYE.pixels).astype(np.float32)[None]
    shifts = [
        cv2.phaseCorrelate(old.copy(), new.copy(), window)[0][0]
        for old, new in itertools.pairwise(lines)
    ]
    return -float(np.median(shifts)) * _SCALE


def _patch(cv2: Any, scene: Scene, twist: FloatArray) -> float:
    """Return the velocity along the axis from `_FRAMES` frames of an optical-flow patch [m/s]."""
    generator = np.random.default_rng(0)
    frames = [
        _frame(cv2, scene.texture, pose, generator)
        for pose in poses_at(np.arange(_FRAMES) / _FRAME_RATE, scene.start, twist)
    ]
    shift = float(np.median([_moved(cv2, old, new) for old, new in itertools.pairwise(frames)]))
    if abs(shift) * (_FRAMES - 1) < _SPANNED:
        shift = _moved(cv2, frames[0], frames[-1]) / (_FRAMES - 1)
    return shift * _FRAME_RATE * _EYE.length / _PIXELS


def _moved(cv2: Any, old: Float32Array, new: Float32Array) -> float:
    """Return the displacement along the axis between two frames [px].

    A phase correlation gives the displacement, and the method of Lucas and Kanade refines it.
    """
    window = cv2.createHanningWindow((_PIXELS, _PIXELS), cv2.CV_32F)
    # Copies are needed because OpenCV multiplies its arguments by the window.
    d = np.array(cv2.phaseCorrelate(old.copy(), new.copy(), window)[0])
    first, second = (cv2.GaussianBlur(frame, (0, 0), _SMOOTH) for frame in (old, new))
    for _ in range(_ROUNDS):
        matrix = np.array([[1.0, 0.0, -d[0]], [0.0, 1.0, -d[1]]])
        moved = cv2.warpAffine(second, matrix, (_PIXELS, _PIXELS), flags=cv2.INTER_CUBIC)
        edge = int(np.ceil(np.abs(d).max())) + 3
        if 2 * edge > _PIXELS - 8:
            break
        inner = (slice(edge, -edge), slice(edge, -edge))
        slope_y, slope_x = np.gradient(0.5 * (first + moved))
        slopes = np.stack((slope_x[inner].ravel(), slope_y[inner].ravel()))
        d = d + np.linalg.solve(slopes @ slopes.T, slopes @ (first - moved)[inner].ravel())
    return -float(d[0])


def _frame(
    cv2: Any, texture: GroundTexture, pose: FloatArray, generator: np.random.Generator
) -> Float32Array:
    """Return the noisy picture that an optical-flow patch takes at a pose.

    Args:
        cv2: the module of OpenCV.
        texture: the ground.
        pose: x, y [m] and yaw [rad] of the patch; the rows of the picture are along its x axis.
        generator: random generator of the noise.
    """
    count = _PIXELS * _FINE
    place = ((np.arange(count) + 0.5) / count - 0.5) * _EYE.length
    along, across = np.meshgrid(place, place)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x = (pose[0] + c * along - s * across) / texture.texel - 0.5
    y = (pose[1] + s * along + c * across) / texture.texel - 0.5
    n = len(texture.gray)
    seen = cv2.remap(
        texture.gray, (x % n).astype(np.float32), (y % n).astype(np.float32), cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_WRAP,
    )  # fmt: skip
    mean = seen.reshape(_PIXELS, _FINE, _PIXELS, _FINE).mean(axis=(1, 3))
    noisy = np.rint(mean + generator.normal(0.0, _NOISE, mean.shape))
    return np.asarray(noisy.clip(0, 255), np.float32)


def _draw(rows: list[tuple[str, str, int, float, float, float]]) -> Figure:
    """Draw the errors without camera faults versus speed, one panel for each ground and angle."""
    title = "RMS error of the velocity along the axis without a fault; Cramer-Rao bound dashed"
    size, y = (15.0, 6.4), tuple(f"RMS error at {angle} deg [mm/s]" for angle in _ANGLES)
    figure, panels = style.panels(
        title, len(_ANGLES), len(_GROUNDS), size=size, x="speed [m/s]", y=y, sharey="row"
    )
    for line, angle in enumerate(_ANGLES):
        for column, kind in enumerate(_GROUNDS):
            axes = panels[line, column]
            axes.set_title(kind.replace("_", " "))
            own = [r for r in rows if r[1:3] == (kind, angle)]
            for name, color in zip((*METHODS, *_OTHERS), style.WHEEL_COLORS, strict=False):
                curve = [(r[3], r[4]) for r in own if r[0] == name]
                if curve:
                    axes.loglog(*zip(*curve, strict=True), "o-", color=color, label=name)
            axes.loglog(_SPEEDS, [r[5] for r in own if r[0] == METHODS[0]], "k--", label="bound")
    panels[0, -1].legend()
    return figure
