"""Motions of line cameras, and faults of the cameras, of the light and of their data.

Some faults occur only in certain motions, such as a cover in slow motion; others are only a motion
that is difficult for the odometry, such as a start.
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from omni_core.quantities import FloatArray
from omni_core.sensors import LineSensor
from omni_sim.camera.configuration import ORDINARY, CameraConfiguration, CameraFault

SENSORS: Mapping[str, LineSensor] = {
    "left": LineSensor(x=0.0, y=0.5, heading_deg=0.0),
    "right": LineSensor(x=0.0, y=-0.5, heading_deg=0.0),
    "front": LineSensor(x=0.6, y=0.0, heading_deg=90.0),
}
_Speeds = tuple[tuple[float, float], ...]
_CONSTANT: _Speeds = ((0.0, 1.0), (1.0, 1.0))


@dataclasses.dataclass(frozen=True)
class PathMotion:
    """Motion along a circle or a straight line, with a speed that changes with time.

    Attributes:
        twist: twist at a relative speed of 1 (v_x, v_y [m/s], yaw rate [rad/s]).
        speeds: times [s] and relative speeds [1] between which the speed is linear; after the last
            time it stays constant.
    """

    twist: tuple[float, float, float]
    speeds: _Speeds = _CONSTANT

    def traveled(self, time: FloatArray) -> FloatArray:
        """Return how long the constant `twist` would take for the same path [s], shape (t,).

        Args:
            time: time that this motion takes for the path [s], shape (t,).
        """
        knots, speeds = np.array(self.speeds).T
        before = np.clip(np.searchsorted(knots, time, "right") - 1, 0, len(knots) - 1)
        ways = np.append(0.0, np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * np.diff(knots)))
        mean = 0.5 * (speeds[before] + np.interp(time, knots, speeds))
        return np.asarray(ways[before] + mean * (time - knots[before]), np.float64)


def _along(speed: float, angle_deg: float, speeds: _Speeds = _CONSTANT) -> PathMotion:
    """Return a straight motion at a speed [m/s] in a direction [deg]."""
    angle = math.radians(angle_deg)
    return PathMotion((speed * math.cos(angle), speed * math.sin(angle), 0.0), speeds)


MOTIONS: tuple[PathMotion, ...] = (
    PathMotion((10.0, 0.0, 0.0)),
    PathMotion((8.0, 0.0, 0.3), ((0.0, 1.0), (1.0, 0.0))),
    PathMotion((5.0, 0.0, 0.0), ((0.0, 1.0), (0.6, 0.1))),
    PathMotion((4.0, -3.0, 0.8)),
    PathMotion((3.0, 1.0, 0.5)),
    PathMotion((2.0, 0.0, 0.0)),
    PathMotion((1.0, 0.3, -0.3), ((0.0, 1.0), (1.0, 2.0))),
    PathMotion((0.5, 0.0, 0.0)),
    PathMotion((0.2, 0.1, 0.05)),
    PathMotion((0.05, 0.0, 0.0)),
    PathMotion((0.0, 0.0, 0.0)),
    PathMotion((0.0, 3.0, 0.0)),
    PathMotion((0.0, -1.0, 0.2)),
    PathMotion((0.0, 0.0, 1.5)),
)
LEAD = 0.3
"""Duration of the motion before a case that requires an earlier motion [s]."""

_ANGLES = (0.0, 25.0, 50.0, 75.0, 100.0, 130.0, 160.0)  # deg, seven directions
_STOP = ((0.0, 1.0), (0.2, 1.0), (LEAD - 0.02, 0.0))  # from 0.5 m/s with 6 m/s^2
_REST = (PathMotion((0.0, 0.0, 0.0)),) * len(_ANGLES)
_CREEP = tuple(_along(1e-3 * mm, angle) for mm in range(1, 6) for angle in (0.0, 37.0))
_LATE_CREEP = tuple(
    _along(0.5, angle, ((0.0, 1.0), (0.2, 1.0), (LEAD - 0.02, 2e-3 * mm)))
    for mm in range(1, 6)
    for angle in (0.0, 37.0)
)
_WALK = tuple(_along(0.3, angle) for angle in _ANGLES)
_BELOW_COVER = (  # slower than 0.65 m/s, where no camera sees new ground within one batch
    PathMotion((0.5, 0.4, 0.5)),
    PathMotion((0.3, 0.2, 0.0)),
    PathMotion((0.2, 0.1, 0.3)),
    PathMotion((0.5, 0.1, 0.0)),
    PathMotion((0.1, 0.0, 0.0)),
    PathMotion((0.0, 0.3, 0.0)),
    PathMotion((0.0, 0.0, 0.8)),
)


@dataclasses.dataclass(frozen=True)
class IntegrityCase:
    """A fault of line cameras, of the light or of their data, or a difficult motion.

    Attributes:
        camera: optics, pixels and faults of the cameras; the times of the faults are counted from
            the start of the drive.
        rate: ratio of the configured to the true line rate [1].
        lost: interval between missing lines [lines]; 0 for none.
        swapped: interval between batches that arrive in the wrong order [batches]; 0 for none.
        repeated: interval between batches that are repeated in place of the next batch [batches]; 0
            for none.
        repeats: whether the ground repeats within the field of view.
        level: mean gray level of the lines, which replaces `camera.gain`; 0 to keep the gain.
        heave: relative change of the view by heave of 30 Hz; needs an ordinary lens.
        motions: motions of the cameras.
        lead: time at the start of a drive that is not counted [s].
        before: kind of the ground during the lead; empty for the ground of the drive.
    """

    camera: CameraConfiguration = dataclasses.field(default_factory=CameraConfiguration)
    rate: float = 1.0
    lost: int = 0
    swapped: int = 0
    repeated: int = 0
    repeats: bool = False
    level: float = 0.0
    heave: float = 0.0
    motions: tuple[PathMotion, ...] = MOTIONS
    lead: float = 0.0
    before: str = ""

    @property
    def covered(self) -> frozenset[str]:
        """Names of the cameras that a fault covers."""
        return frozenset(f.camera for f in self.camera.faults.values() if f.kind == "cover")


def _camera(**changes: Any) -> IntegrityCase:
    return IntegrityCase(camera=CameraConfiguration(**changes))


def _timed(kind: str, amplitude: float, time: float = 0.0, camera: str = "") -> CameraConfiguration:
    fault = CameraFault(kind=kind, amplitude=amplitude, time=time, camera=camera)
    return CameraConfiguration(faults={kind: fault})


def _walk(camera: CameraConfiguration, before: str = "") -> IntegrityCase:
    lead = LEAD if before else 0.0
    return IntegrityCase(camera=camera, motions=_WALK, lead=lead, before=before)


_NOTHING = CameraConfiguration()
_DIRTY = CameraConfiguration(dirt_spots=30)
_UNEQUAL = CameraConfiguration(photo_response=0.05)
_MUDDY = CameraConfiguration(mud=0.28)
_FLICKER = _timed("flicker", 0.2)
_HEAVE = CameraConfiguration(lens=ORDINARY)

FAULTS: Mapping[str, IntegrityCase] = {
    "none": IntegrityCase(),
    "dirt_spots": IntegrityCase(camera=_DIRTY),
    "stuck_pixel": _camera(stuck_pixels=1),
    "hot_pixels": _camera(hot_pixels=10),
    "prnu": IntegrityCase(camera=_UNEQUAL),
    "dark_steps": _camera(dark_steps=3.0),
    "mud": _camera(mud=0.25),
    "shadow_fixed": _camera(shadow=0.5),
    "shadow_moving": _camera(shadow=0.5, shadow_speed=0.3),
    "lost_lines": IntegrityCase(lost=30),
    "wrong_rate": IntegrityCase(rate=1.04),
    "swapped_batches": IntegrityCase(swapped=5),
    "repeated_batches": IntegrityCase(repeated=5),
    "repeating_ground": IntegrityCase(repeats=True),
    "flicker": IntegrityCase(camera=_FLICKER),
    "low_light": IntegrityCase(camera=CameraConfiguration(noise=0.7), level=6.0),
    "heave": IntegrityCase(camera=_HEAVE, heave=0.02),
    "late_dirt": IntegrityCase(camera=_timed("dirt", 30.0, 0.05)),
    "lost_light": IntegrityCase(camera=_timed("light", 0.9, 0.05)),
    "creep": IntegrityCase(motions=_CREEP),
    "creep_prnu": IntegrityCase(camera=_UNEQUAL, motions=_CREEP),
    "creep_after_motion": IntegrityCase(motions=_LATE_CREEP, lead=LEAD),
    "start": IntegrityCase(
        motions=tuple(_along(1.0, a, ((0.0, 0.0), (0.02, 0.0), (1.02, 1.0))) for a in _ANGLES)
    ),
    "stop": IntegrityCase(
        motions=tuple(_along(0.5, a, ((0.0, 1.0), (0.02, 1.0), (0.0825, 0.0))) for a in _ANGLES)
    ),
    "rest": IntegrityCase(motions=_REST),
    "rest_flicker": IntegrityCase(camera=_FLICKER, motions=_REST),
    "rest_after_motion": IntegrityCase(
        motions=tuple(_along(0.5, a, _STOP) for a in _ANGLES), lead=LEAD
    ),
    "walk": _walk(_NOTHING),
    "walk_dirt": _walk(_DIRTY),
    "walk_prnu": _walk(_UNEQUAL),
    "walk_mud": _walk(_MUDDY),
    "walk_after_gravel": _walk(_NOTHING, "gravel"),
    "walk_after_gravel_dirt": _walk(_DIRTY, "gravel"),
    "walk_after_gravel_prnu": _walk(_UNEQUAL, "gravel"),
    "walk_after_gravel_mud": _walk(_MUDDY, "gravel"),
    "cover_left": IntegrityCase(
        camera=_timed("cover", 1.0, LEAD, "left"), motions=_BELOW_COVER, lead=LEAD
    ),
    "cover_front": IntegrityCase(
        camera=_timed("cover", 1.0, LEAD, "front"), motions=_BELOW_COVER, lead=LEAD
    ),
}
"""Faults and difficult motions, keyed by name."""

OF_TIME = ("lost_lines", "wrong_rate", "swapped_batches", "repeated_batches")
"""Faults of stamps and of the number of lines."""

EVERYWHERE = tuple(FAULTS)[: tuple(FAULTS).index("flicker") + 1]
"""Faults that are injected on all grounds."""
