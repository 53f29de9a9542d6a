"""Reference motion of a recording: the true motion, or the motion according to the wheel speeds."""

import math

import numpy as np

from omni_core import kinematics, topics
from omni_core.quantities import BoolArray, FloatArray
from omni_recording import error, folder
from omni_runs import experiment, recorded_run

TRUTH, WHEELS, AUTO = "truth", "wheels", "auto"
REFERENCES = (AUTO, TRUTH, WHEELS)

_TOPICS = {TRUTH: topics.GROUND_TRUTH, WHEELS: topics.WHEEL_STATES}
_SPREAD = 3  # number of samples before and after a sample from which its acceleration is computed


def read_reference(
    bag: folder.Bag, configuration: experiment.ExperimentConfiguration, kind: str
) -> tuple[FloatArray, FloatArray, str]:
    """Return times, twists and kind of the reference motion of a recording.

    Wheel speeds are used only while they are nearly constant, because accelerated wheels slip.
    Twists at other times are NaN.

    Args:
        bag: the recording.
        configuration: configuration of the vehicle.
        kind: one of `REFERENCES`; `AUTO` selects the true motion if it was recorded, and otherwise
            the motion according to the wheel speeds.

    Returns:
        Times [s], shape (K,); twists (v_x, v_y, yaw rate) in the body frame [m/s, m/s, rad/s],
        shape (K, 3); the kind that was used, `TRUTH` or `WHEELS`.

    Raises:
        BagError: the recording does not contain the reference.
    """
    streams = recorded_run.read_streams(bag, _TOPICS.values())
    if kind == AUTO:
        kind = TRUTH if _TOPICS[TRUTH].name in streams else WHEELS
    stream = streams.get(_TOPICS[kind].name)
    wheels = list(configuration.vehicle.wheels)
    stamps: list[float] = []
    values: list[list[float]] = []
    for stamp_ns, message in zip(stream.stamp_ns, stream.messages, strict=True) if stream else ():
        if kind == TRUTH:
            place, turn = message.pose.pose.position, message.pose.pose.orientation
            values.append([place.x, place.y, 2.0 * math.atan2(turn.z, turn.w)])
        else:
            speed = dict(zip(message.name, message.velocity, strict=False))
            if any(name not in speed for name in wheels):
                continue
            values.append([float(speed[name]) for name in wheels])
        stamps.append(1e-9 * float(stamp_ns))
    if len(stamps) < 2 * _SPREAD + 1:
        raise error.BagError(
            bag.path, f"contains no motion to compare with on {_TOPICS[kind].path}"
        )
    time, known = np.array(stamps), np.array(values)
    if kind == TRUTH:
        time, known = _means(time, known)
    else:
        known = kinematics.PlatformKinematics(configuration.vehicle.wheels).twist(known)
        known[_accelerating(time, known)] = np.nan
    return time, known, kind


def _means(time: FloatArray, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the mean twist between each pose and the next; short shocks hardly affect it.

    Args:
        time: times of the poses [s], shape (K,).
        pose: x, y, yaw in the world [m, m, rad], shape (K, 3).

    Returns:
        Middle of each interval [s], shape (J,) with J < K; twists v_x, v_y, yaw rate in the body
        frame [m/s, m/s, rad/s], shape (J, 3).
    """
    elapsed = np.diff(time)
    moving = elapsed > 0.0
    place = np.diff(pose[:, :2], axis=0)
    turn = (np.diff(pose[:, 2]) + math.pi) % (2.0 * math.pi) - math.pi
    yaw = pose[:-1, 2] + 0.5 * turn
    chord = np.sinc(0.5 * turn / math.pi)  # ratio of chord length to arc length
    cos, sin = np.cos(yaw) / chord, np.sin(yaw) / chord
    path = np.column_stack(
        (cos * place[:, 0] + sin * place[:, 1], cos * place[:, 1] - sin * place[:, 0], turn)
    )
    return (0.5 * (time[1:] + time[:-1]))[moving], path[moving] / elapsed[moving, None]


def _accelerating(time: FloatArray, twist: FloatArray, steady: float = 1.0) -> BoolArray:
    """Return for each sample whether the acceleration is so large that wheels may slip, shape (K,).

    Args:
        time: times [s], shape (K,).
        twist: twists [m/s, m/s, rad/s], shape (K, 3).
        steady: limit on the acceleration [m/s^2, rad/s^2].
    """
    padded = np.pad(twist, ((_SPREAD, _SPREAD), (0, 0)), mode="edge")
    span = np.pad(time, _SPREAD, mode="edge")
    elapsed = np.maximum(span[2 * _SPREAD :] - span[: -2 * _SPREAD], 1e-9)
    change = np.abs(padded[2 * _SPREAD :] - padded[: -2 * _SPREAD])
    sharp: BoolArray = np.max(change, axis=1) / elapsed > steady
    return sharp
