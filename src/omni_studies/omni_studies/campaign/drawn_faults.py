"""Faults that `sensor_faults` draws, and what each of them changes in an experiment."""

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from omni_core.quantities import GRAVITY
from omni_runs.history import FastRun
from omni_sim.configuration import GroundConfiguration
from omni_sim.ground.configuration import FrictionPatch
from omni_sim.masses import MassConfiguration
from omni_sim.push import Push
from omni_sim.sensor_configuration import FaultConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration

SIZES = {
    "twist": (0.1, 5.0),
    "rate": (0.03, 3.0),
    "gyro": (0.03, 3.0),
    "accelerometer": (0.3, 15.0),
    "encoder": (0.5, 40.0),
}
"""Smallest and largest size of a fault, in the unit of the channel; "rate" denotes the yaw rate of
the twist."""

SHARES = ("scale", "echo")
"""Kinds of fault whose size is a share."""

_REPETITIONS = 20  # of an intermittent fault
_WIDE = 100.0  # extent of a patch of ice, longer than any stop [m]


class SensorFault(NamedTuple):
    """A fault of sensors or a brake.

    Attributes:
        channel: faulty channel, channels joined by ``+``, ``brake``, or for an event ``ground``,
            ``load`` or ``chassis``.
        kind: kind of the fault: a value of `FaultConfiguration.kind`, the field of
            `WheelCondition` that a brake fault sets, ``ice``, ``payload`` or ``push``.
        axis: index of the faulty axis or wheel, -1 for all; side of the ice, 0 for the left; corner
            of payload or push, counter-clockwise from the front left.
        onset: time from pressing the pedal to the fault [s].
        amplitude: size of the fault in the unit of the first channel; `configurations` derives the
            size in the other channels. Friction of ice relative to the ground, mass of the payload
            relative to that of the vehicle, and force of a push relative to its weight [1].
        period: duration of a ramp or push, period of a sine or square wave, or length of a delay
            [s].
        burst: duration of an intermittent fault, and time until the next one [s]; 0 if the fault
            is permanent.
    """

    channel: str
    kind: str
    axis: int
    onset: float
    amplitude: float
    period: float
    burst: float = 0.0


def size_range(channel: str, kind: str, axis: int) -> tuple[float, float]:
    """Return the smallest and largest size of a fault, in the unit of the channel or as a share."""
    if kind in SHARES:
        return 0.05, 1.5
    return SIZES["rate" if channel == "twist" and axis == 2 else channel]


def configurations(fault: SensorFault, time: float) -> dict[str, FaultConfiguration]:
    """Return the fault of each affected channel, keyed by channel.

    The amplitudes of several channels are at the same relative position in the logarithmic ranges
    of these channels. The axis of a fault is an axis of the twist. For x and y,
    it is also the axis of the accelerometer; a fault of the yaw rate affects both axes of the
    accelerometer. Gyro and encoders are affected as a whole.
    """
    channels = fault.channel.split("+")
    low, high = size_range(channels[0], fault.kind, fault.axis)
    share = np.log(max(abs(fault.amplitude), 1e-9) / low) / np.log(high / low)
    faults = {}
    for channel in channels:
        first, last = size_range(channel, fault.kind, fault.axis)
        axis = fault.axis
        if len(channels) > 1:
            axis = {"twist": axis, "accelerometer": axis if axis < 2 else -1}.get(channel, -1)
        size = float(np.copysign(first * (last / first) ** share, fault.amplitude))
        one = FaultConfiguration(channel=channel, kind=fault.kind, axis=axis, time=time)
        one = dataclasses.replace(one, amplitude=size, period=fault.period)
        if fault.burst == 0.0:
            faults[channel] = one
        for k in range(_REPETITIONS if fault.burst > 0.0 else 0):
            start = round(time + 2.0 * k * fault.burst, 3)
            faults[f"{channel}_{k}"] = dataclasses.replace(one, time=start, duration=fault.burst)
    return faults


def with_ice(
    ground: GroundConfiguration, fault: SensorFault, path: FastRun, time: float
) -> GroundConfiguration:
    """Return the ground with ice on one side of the line of motion, from a time on [s].

    Args:
        ground: ground without ice.
        fault: event with the side and the friction of the ice.
        path: stop without the event, which gives place and direction of the vehicle at this time.
        time: time at which the vehicle reaches the ice [s].
    """
    k = _stamp(path, time)
    (x, y), (x_0, y_0) = path.pose[k, :2], path.pose[k - 1, :2]
    along = math.atan2(y - y_0, x - x_0)
    across = along + math.copysign(0.5 * math.pi, 0.5 - fault.axis)
    half = 0.5 * _WIDE
    ice = FrictionPatch(
        x=float(x + half * (math.cos(along) + math.cos(across))),
        y=float(y + half * (math.sin(along) + math.sin(across))),
        length=_WIDE,
        width=_WIDE,
        heading_deg=math.degrees(along),
        friction=fault.amplitude * ground.friction,
    )
    return dataclasses.replace(ground, patches={**ground.patches, "ice": ice})


def with_payload(vehicle: VehicleConfiguration, fault: SensorFault) -> VehicleConfiguration:
    """Return the vehicle with a further load at a corner, of which the assistant does not know.

    The load is halfway between the center and the corner of the chassis. It is a point mass at the
    height of the center of gravity of the vehicle's body.
    """
    ahead, left = _corner(fault)
    old, mass = vehicle.load, fault.amplitude * vehicle.body.mass
    share = mass / (mass + old.mass)
    load = MassConfiguration(
        mass=mass + old.mass,
        x=old.x + share * (vehicle.chassis_x + 0.25 * ahead * vehicle.chassis_length - old.x),
        y=old.y + share * (vehicle.chassis_y + 0.25 * left * vehicle.chassis_width - old.y),
        height=old.height + share * (vehicle.body.height - old.height),
        yaw_inertia=old.yaw_inertia,
    )
    return dataclasses.replace(vehicle, load=load)


def push_of(vehicle: VehicleConfiguration, fault: SensorFault, path: FastRun, time: float) -> Push:
    """Return a push against a corner of the chassis, across the vehicle's axis and toward it.

    Args:
        vehicle: vehicle that is pushed.
        fault: event with corner, force and duration.
        path: stop without the event, which gives the heading of the vehicle at this time.
        time: onset after the start of the run [s].
    """
    (ahead, left), masses = _corner(fault), vehicle.masses
    force, yaw = -left * fault.amplitude * masses.mass * GRAVITY, path.pose[_stamp(path, time), 2]
    lever = vehicle.chassis_x + 0.5 * ahead * vehicle.chassis_length - masses.center[0]
    along = -force * math.sin(yaw), force * math.cos(yaw)
    return Push(time, fault.period, along, float(lever * force))


def _corner(fault: SensorFault) -> tuple[float, float]:
    """Return whether the corner of a fault is ahead and left, 1 or -1 each."""
    return 1.0 if fault.axis in (0, 3) else -1.0, 1.0 if fault.axis < 2 else -1.0


def _stamp(path: FastRun, time: float) -> int:
    """Return the index of the stamp at a time [s]; at least 1, at most that of the last stamp."""
    found = int(np.searchsorted(path.stamp_ns, round(time * 1e9)))
    return min(max(found, 1), len(path.stamp_ns) - 1)
