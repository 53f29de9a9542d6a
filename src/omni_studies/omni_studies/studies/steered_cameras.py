"""Line cameras on vehicles with steered wheels (Figure 70): sideslip, steered carriers, skids.

A forklift with steered rear wheels changes lanes, and brakes on a slippery curve. In the lane
change, a camera on the carrier of a steered wheel measures the sideslip angle of this wheel; the
meter receives the true velocity of the wheel along its rolling direction, and the true rotation
rate of the carrier. Four arrangements of cameras measure the twist: two cameras that are fixed next
to the steered wheels (Ackermann drive), two on the carriers of these wheels, both with the
constraint of the unsteered axle, three cameras on carriers without it, and two cameras next to the
fixed wheels of a differential drive, a forklift with omni-wheels at the rear. On the slippery
curve, all wheels lock and the axle slides sideways, so the constraint is wrong.
"""

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from linescan_odometry.configuration import OdometryConfiguration, SideslipWheel
from linescan_odometry.port import OdometryPort
from linescan_odometry.sideslip import SideslipConfiguration, SideslipMeter, sideslip_angle
from linescan_odometry.twist.least_squares import UNSTEERED_AXLE, KinematicsConfiguration
from omni_core.configuration import Configuration, parameter
from omni_core.geometry import WheelMount, turned
from omni_core.quantities import FloatArray
from omni_core.sensors import LineSensor
from omni_runs.experiment import ExperimentConfiguration, changed
from omni_runs.metrics import Metric
from omni_sim.simulator import Observation, Simulator
from omni_studies.study import StudyResult, StudyRun

_REAR, _FRONT, _SIDE = -0.65, 0.65, 0.5  # positions of the wheels [m]
_WHEELS = ("rear_left", "front_left", "front_right", "rear_right")
_WHEEL = "rear_left"
_LEFT: dict[str, Any] = {"carrier": "rear_left", "carrier_x": _REAR, "carrier_y": _SIDE}
_RIGHT: dict[str, Any] = {"carrier": "rear_right", "carrier_x": _REAR, "carrier_y": -_SIDE}
_CAMERAS = {
    "fixed_left": LineSensor(x=_REAR, y=0.35, heading_deg=0.0),
    "fixed_right": LineSensor(x=_REAR, y=-0.35, heading_deg=0.0),
    "axle_left": LineSensor(x=_FRONT, y=0.35, heading_deg=0.0),
    "axle_right": LineSensor(x=_FRONT, y=-0.35, heading_deg=0.0),
    "carried_left": LineSensor(x=_REAR, y=0.35, heading_deg=0.0, **_LEFT),
    "carried_right": LineSensor(x=_REAR, y=-0.35, heading_deg=0.0, **_RIGHT),
    "sideways": LineSensor(x=_REAR, y=0.35, heading_deg=90.0, **_LEFT),
}
_FRICTION = {"lane_change": 1.0, "skid": 0.4}
"""Friction factor of the ground in each maneuver [1]."""
_AXLE = KinematicsConfiguration(constraint=UNSTEERED_AXLE, axle_x=_FRONT)
_ARRANGEMENTS = {
    "ackermann": ("fixed_left", "fixed_right"),
    "carriers": ("carried_left", "carried_right"),
    "three_on_carriers": ("carried_left", "carried_right", "sideways"),
    "differential": ("axle_left", "axle_right"),
}


class Options(Configuration):
    """Options of the study ``steered_cameras``: ground and seed."""

    ground: str = parameter("asphalt")
    """ground: a file of config/grounds/"""
    seed: int = parameter(1, minimum=0)
    """seed of the camera noise"""


class Batch(NamedTuple):
    """Measurements in one control period, and the true motion in the middle of it.

    Attributes:
        observation: observation at the end of the period.
        twist: true twist [m/s, m/s, rad/s], shape (3,).
        angle: true steering angle of each wheel [rad], shape (N,).
        rate: true rate of these angles [rad/s], shape (N,).
    """

    observation: Observation
    twist: FloatArray
    angle: FloatArray
    rate: FloatArray


def run(options: Options, study: StudyRun) -> StudyResult:
    """Drive both maneuvers on both vehicles; report the errors."""
    metrics: dict[str, Metric] = {}
    for name, friction in _FRICTION.items():
        given = f"ground={options.ground}", f"seed={options.seed}", f"ground.friction={friction}"
        steered = study.experiments.load("steered_cameras", name, given)
        for arrangements, configuration in (
            (("ackermann", "carriers", "three_on_carriers"), _with_cameras(steered)),
            (("differential",), _with_cameras(_differential(steered))),
        ):
            batches = tuple(_drive(configuration))
            for arrangement in arrangements:
                cameras = {one: configuration.sensors[one] for one in _ARRANGEMENTS[arrangement]}
                metrics |= _twist_errors(f"{arrangement}_{name}", cameras, batches)
            if name == "lane_change" and "ackermann" in arrangements:
                metrics |= _sideslip_errors(configuration.sensors["sideways"], batches)
    return study.result(metrics)


def _differential(steered: ExperimentConfiguration) -> ExperimentConfiguration:
    """Return the experiment with omni-wheels, which roll freely sideways, at the rear."""
    wheels = {
        name: WheelMount(x=mount.x, y=mount.y, radius=mount.radius, roller_angle_deg=0.0)
        if mount.is_steered
        else mount
        for name, mount in steered.vehicle.wheels.items()
    }
    return changed(steered, vehicle={"wheels": wheels}, brake_assist={"wheels": wheels})


def _with_cameras(configuration: ExperimentConfiguration) -> ExperimentConfiguration:
    """Return the experiment with all cameras for whose carriers the vehicle has steered wheels."""
    wheels = configuration.vehicle.wheels
    sensors = {
        name: one
        for name, one in _CAMERAS.items()
        if not one.carrier or wheels[one.carrier].is_steered
    }
    odometry = {"sensors": sensors, "kinematics": _AXLE}
    return changed(configuration, sensors=sensors, odometry=odometry)


def _drive(configuration: ExperimentConfiguration) -> Iterator[Batch]:
    """Yield the batches of a drive that ends with the driver's demands."""
    simulator = Simulator(configuration)
    enable = np.ones(len(configuration.vehicle.wheels))
    before = simulator.observe()
    while before.stamp_ns < configuration.maneuver.earliest_end * 1e9:
        simulator.advance(enable)
        after = simulator.observe()
        angles = before.steering_angle, after.steering_angle
        rate = (angles[1] - angles[0]) / configuration.simulation.control_period
        twist = 0.5 * (before.twist + after.twist)
        # The lines are rendered before the next step.
        seen = dataclasses.replace(after, line_batches=dict(after.line_batches))
        yield Batch(seen, twist, 0.5 * (angles[0] + angles[1]), rate)
        before = after


def _twist_errors(
    case: str, sensors: Mapping[str, LineSensor], batches: Sequence[Batch]
) -> dict[str, Metric]:
    """Return the RMS errors of the twist that the cameras of an arrangement measure.

    Args:
        case: name of the case.
        sensors: cameras of the arrangement.
        batches: batches of a drive.
    """
    port = OdometryPort("", OdometryConfiguration(sensors=sensors, kinematics=_AXLE))
    errors, slid, skids = [], [], 0
    for batch in batches:
        angles = dict(zip(_WHEELS, batch.observation.steering_angle.tolist(), strict=True))
        estimates = [*port.steer(batch.observation.stamp_ns, angles)]
        for name in sensors:
            estimates += port.take(name, batch.observation.line_batches[name])
        for estimate, _ in estimates:
            if estimate.measured:
                errors.append(estimate.twist - batch.twist)
                slid.append(batch.twist[1] + _FRONT * batch.twist[2])
                skids += bool(estimate.skid)
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    return {
        f"forward_error.{case}": Metric(float(rms[0]), "m/s"),
        f"sideways_error.{case}": Metric(float(rms[1]), "m/s"),
        f"yaw_rate_error.{case}": Metric(float(rms[2]), "rad/s"),
        f"axle_slip.{case}": Metric(float(np.sqrt(np.mean(np.square(slid)))), "m/s"),
        f"reported_skids.{case}": Metric(skids / len(errors), "1"),
        f"measured_share.{case}": Metric(len(errors) / len(batches), "1"),
    }


def _sideslip_errors(camera: LineSensor, batches: Sequence[Batch]) -> dict[str, Metric]:
    """Return errors and largest value of the sideslip angle of the steered wheel [deg].

    Args:
        camera: camera on the carrier of the wheel.
        batches: batches of a drive.
    """
    wheel = SideslipWheel(sensor="sideways", x=_REAR, y=_SIDE)
    meter = SideslipMeter(
        SideslipConfiguration(sensors={"sideways": camera}, sideslip={_WHEEL: wheel}), _WHEEL
    )
    errors, truths = [], []
    for batch in batches:
        angle, rate = float(batch.angle[0]), float(batch.rate[0])
        velocity = batch.twist[:2] + batch.twist[2] * np.array([-_SIDE, _REAR])
        forward, left = turned(velocity, -angle).tolist()
        lines = batch.observation.line_batches["sideways"]
        estimate = meter.update(lines, forward, float(batch.twist[2]) + rate)
        if estimate.measured:
            truths.append(math.degrees(sideslip_angle(left, forward)))
            errors.append(math.degrees(estimate.angle) - truths[-1])
    return {
        "sideslip_error.lane_change": Metric(float(np.sqrt(np.mean(np.square(errors)))), "deg"),
        "largest_sideslip_error.lane_change": Metric(float(np.max(np.abs(errors))), "deg"),
        "largest_sideslip.lane_change": Metric(float(np.max(np.abs(truths))), "deg"),
        "measured_share.sideslip": Metric(len(errors) / len(batches), "1"),
    }
