"""Line-scan odometry: from batches of lines of several cameras to the twist of the platform.

One of two methods converts the lines of each sensor to a velocity along the sensor's axis. Weighted
least squares combine these velocities into the twist. The twist is the mean over the batch, so it
lags by half the duration of a batch. At 100 batches per second the lag is 5 ms, which is an error
of 0.05 m/s at an acceleration of 10 m/s^2.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from linescan_odometry import measurements
from linescan_odometry.configuration import OdometryConfiguration
from linescan_odometry.keyframe import Keyframe, kept
from linescan_odometry.measurements import FlowReading, SensorReading, TwistEstimate
from linescan_odometry.sensor import SensorOdometry
from linescan_odometry.twist.flow import FlowMonitor
from linescan_odometry.twist.least_squares import UNKNOWNS, Solution, TwistSolver
from linescan_odometry.unsuitable_views import UnsuitableViews
from omni_core.configuration import ConfigurationError
from omni_core.quantities import FloatArray
from omni_core.sensors import carried_velocity, turned_mount
from omni_core.signals import Flow, LineBatch, LineBatchError

__all__ = ["LineBatch", "LineScanOdometry", "OdometryConfiguration", "TwistEstimate"]

_EARLIEST_NS = 500_000_000  # ns; limit on the time by which a camera may be ahead of the others


class LineScanOdometry:
    """Body twist from one-dimensional line cameras, optical-flow sensors, or both."""

    def __init__(self, configuration: OdometryConfiguration) -> None:
        """Create the odometry for the sensors of a configuration.

        Raises:
            ConfigurationError: the placement of the sensors is singular, or a reference table
                cannot be used.
        """
        self._configuration = configuration
        self._skew = configuration.skew
        try:
            self._sensors = {
                name: SensorOdometry(sensor, configuration, _tables(configuration, name))
                for name, sensor in configuration.sensors.items()
            }
        except LineBatchError as error:
            raise ConfigurationError("flat_field_tables", str(error)) from None
        self._flows = {
            name: FlowMonitor(sensor, configuration.maximum_acceleration)
            for name, sensor in configuration.flow_sensors.items()
        }
        self._solver = TwistSolver(
            configuration.all_sensors, configuration.minimum_lever, configuration.kinematics
        )
        # Views are compared with the twist only for cameras that are fixed to the body.
        watched = configuration.sensors if configuration.cover_detection else {}
        self._views = UnsuitableViews({n: s for n, s in watched.items() if not s.carrier})
        self._carried = np.zeros(0)  # velocities due to the steering rates [m/s], shape (R,)
        self._stamp_ns = 0
        self._early: list[tuple[LineBatch, Callable[[], SensorReading]]] = []

    def match(self, name: str, batch: LineBatch) -> None:
        """Start to process the lines of one camera before lines of the other cameras arrive.

        The next `update` uses the result.

        Args:
            name: name of the camera.
            batch: lines of the camera; each batch must be given once and in order.
        """
        if name in self._sensors:
            self._early.append((batch, self._sensors[name].begin(batch)))
            self._early = [
                (taken, begun)
                for taken, begun in self._early
                if abs(batch.stamp_ns - taken.stamp_ns) <= _EARLIEST_NS
            ]

    def update(
        self,
        batches: Mapping[str, LineBatch | Flow],
        steering: Mapping[str, tuple[float, float]] | None = None,
    ) -> TwistEstimate:
        """Return the twist estimated from the measurements since the last update.

        Args:
            batches: batches of the cameras and measurements of the flow sensors, keyed by sensor
                name. A sensor without an entry counts as unmeasured.
            steering: mean angle [rad] and rate [rad/s] of each carrier during the batch, keyed by
                wheel. A sensor whose carrier has no entry counts as unmeasured.

        Raises:
            LineBatchError: a name does not belong to a configured camera (for lines) or flow
                sensor.
        """
        lines: dict[str, LineBatch] = {}
        flows: dict[str, Flow] = {}
        for name, batch in batches.items():
            if isinstance(batch, Flow) and name in self._flows:
                flows[name] = batch
            elif isinstance(batch, LineBatch) and name in self._sensors:
                lines[name] = batch
            else:
                known = ", ".join(self._flows if isinstance(batch, Flow) else self._sensors)
                kind = "flow sensors" if isinstance(batch, Flow) else "sensors"
                raise LineBatchError(f"{name!r} is not one of the {kind} {known}")
        if batches:
            self._stamp_ns = max(batch.stamp_ns for batch in batches.values())
        readings = {name: self._read(name, lines.get(name)) for name in self._sensors}
        measured = {name: self._read_flow(name, flows.get(name)) for name in self._flows}
        covered = self._views.stopped(self._stamp_ns, readings)
        for name in covered:
            self._sensors[name].discard()
        readings |= covered
        if self._configuration.is_steered:
            readings |= self._turn(readings, steering or {})
        return self._estimate(readings, measured)

    def _turn(
        self, readings: Mapping[str, SensorReading], steering: Mapping[str, tuple[float, float]]
    ) -> dict[str, SensorReading]:
        """Turn the sensors on steered carriers; return the readings that cannot be used.

        Args:
            readings: readings of all cameras.
            steering: mean angle [rad] and rate [rad/s] of each carrier, keyed by wheel.
        """
        turned, carried, unknown = {}, [], {}
        for name, sensor in self._configuration.all_sensors.items():
            angle, rate = steering.get(sensor.carrier, (0.0, 0.0))
            if sensor.carrier and sensor.carrier not in steering and name in readings:
                unknown[name] = SensorReading.unmeasured(f"no steering angle of {sensor.carrier}")
            turned[name] = turned_mount(sensor, angle) if sensor.carrier else sensor
            carried += carried_velocity(turned[name], rate)
        given = self._configuration
        try:
            self._solver = TwistSolver(turned, given.minimum_lever, given.kinematics)
        except ConfigurationError as error:  # at this angle, the sensors do not suffice
            words = f"steered: {error.problem}"
            return {name: SensorReading.unmeasured(words) for name in readings}
        self._carried = np.array(carried)
        return unknown

    def warm_up(self) -> None:
        """Compile or load all kernels, so that the first update is as fast as later updates.

        The state of this object does not change, because a separate instance processes lines of the
        same sizes.
        """
        trial = LineScanOdometry(self._configuration)
        generator = np.random.default_rng(0)
        for name, sensor in self._configuration.sensors.items():
            ground = generator.integers(0, 200, 2 * sensor.pixels)
            rows, columns = np.ogrid[:16, : sensor.pixels]
            at_rest, moving = ground[0 * rows + columns], ground[rows + columns]
            noise = generator.integers(0, 5, at_rest.shape)
            unmatched = generator.integers(0, 200, at_rest.shape)
            for lines in (at_rest + noise, (at_rest + noise)[:5], moving + noise, unmatched):
                for kind in (np.uint8, np.uint16):
                    trial.update({name: LineBatch(0, lines.astype(kind))})
            keyframe = Keyframe(sensor.pixels)
            for stamp_ns in (0, 1):
                keyframe.compare(stamp_ns, 1.0, at_rest, 0.0)
            kept(at_rest[:2].astype(np.uint16), at_rest[0].astype(np.uint16), 1)

    def _read(self, name: str, batch: LineBatch | None) -> SensorReading:
        if batch is None:
            return SensorReading.unmeasured("no lines arrived")
        early = next((i for i, (taken, _) in enumerate(self._early) if taken is batch), None)
        begun = self._sensors[name].begin(batch) if early is None else self._early.pop(early)[1]
        stale = self._stale(batch)
        reading = begun()
        return SensorReading.unmeasured(stale) if stale else reading

    def _read_flow(self, name: str, flow: Flow | None) -> FlowReading:
        if flow is None:
            return FlowReading.unmeasured("no measurement arrived")
        reading = self._flows[name].read(flow)
        stale = self._stale(flow)
        return FlowReading.unmeasured(stale) if stale else reading

    def _stale(self, batch: LineBatch | Flow) -> str:
        """Return a message if a batch is much older than the newest one, else an empty text."""
        age = 1e-9 * (self._stamp_ns - batch.stamp_ns)
        if age <= self._skew:
            return ""
        return f"stale: {1e3 * age:.3g} ms older than the newest line"

    def _estimate(
        self, readings: dict[str, SensorReading], flows: dict[str, FlowReading]
    ) -> TwistEstimate:
        """Return the twist estimated from all valid readings, except those found to be faulty.

        Excluded readings are marked as unmeasured in the result.
        """
        while True:
            solution = self._solve(readings, flows)
            if solution is None:
                readings = readings | self._views.unconfirmed(self._stamp_ns, readings)
                covariance = measurements.UNMEASURED_VARIANCE * np.eye(3)
                return TwistEstimate(
                    self._stamp_ns, np.zeros(3), covariance, False, readings, flows=flows
                )
            sloping = self._views.sloping(self._stamp_ns, readings, solution.twist)
            if sloping:
                readings = readings | sloping
                continue
            suspect = self._contradicting(solution, [*readings, *flows])
            if suspect is not None:
                name, reason = suspect
                if name in flows:
                    flows = flows | {name: FlowReading.unmeasured(reason)}
                    continue
                reading = readings[name]
                wrong = {
                    name: SensorReading.unmeasured(
                        reason, reading.correlation, reading.inlier_share
                    )
                }
            else:
                wrong = self._views.unsuitable(self._stamp_ns, readings, solution.twist)
            if not wrong:
                return self._checked(solution, readings, flows)
            readings = readings | wrong

    def _solve(
        self, readings: Mapping[str, SensorReading], flows: Mapping[str, FlowReading]
    ) -> Solution | None:
        """Return the twist estimated from all valid readings; None if they do not determine it."""
        each: list[SensorReading | FlowReading] = [*readings.values(), *flows.values()]
        measured = tuple(reading.measured for reading in each)
        velocity = np.array([r.velocity for r in readings.values()])
        variance = np.array([r.variance for r in readings.values()])
        if flows:
            velocity = np.concatenate([velocity, *(f.velocity for f in flows.values())])
            variance = np.diag(np.append(variance, np.zeros(2 * len(flows))))
            for first, flow in zip(
                range(len(readings), len(velocity), 2), flows.values(), strict=True
            ):
                variance[first : first + 2, first : first + 2] = flow.covariance
        if self._carried.size:
            velocity = velocity - self._carried
        limit = self._configuration.contradiction_limit
        return self._solver.estimate(velocity, variance, measured, limit)

    def _contradicting(self, solution: Solution, names: Sequence[str]) -> tuple[str, str] | None:
        """Return the name of a faulty sensor and a description of its contradiction.

        The sensor is the one with the largest residual.

        Args:
            solution: twist of all sensors, with their residuals.
            names: names of the sensors, in the order of the residuals.

        Returns:
            Name and description; None if no residual exceeds the limit, or if the faulty sensor
            cannot be isolated.
        """
        limit = self._configuration.contradiction_limit
        worst = int(np.argmax(solution.scores))
        score = float(solution.scores[worst])
        others = tuple(use and i != worst for i, use in enumerate(solution.measured))
        count = int(np.count_nonzero(self._solver.rows(others)))
        too_few = count <= UNKNOWNS or bool(self._solver.problem(others))
        if not score > limit > 0.0 or too_few:
            return None
        if self._flows:
            # Errors along both axes of one flow sensor can have the same effect as an error of
            # another sensor.
            rivals = np.delete(solution.scores, worst) ** 2 >= score**2 - limit**2
            if rivals.any():
                return None
        return names[worst], f"contradicts the other sensors by {score:.3g} standard deviations"

    def _checked(
        self,
        solution: Solution,
        readings: Mapping[str, SensorReading],
        flows: Mapping[str, FlowReading],
    ) -> TwistEstimate:
        """Return the estimate for a solution, after a check of the solution's residuals.

        If the sensors contradict each other, the covariance is increased. If the sensors contradict
        the kinematic constraint, the estimate contains a description of the skid.
        """
        limit = self._configuration.contradiction_limit
        score = float(solution.scores.max())
        # If the faulty sensor cannot be isolated, the covariance is increased until it includes the
        # error that any single faulty sensor with these residuals could cause.
        inflation = solution.leverage * score**2 if score > limit > 0.0 else 1.0
        covariance = solution.covariance * inflation
        skid = ""
        axle = self._configuration.kinematics.axle
        if axle is not None and not solution.assumed:
            skid = self._skid(axle, solution.twist, covariance, solution.last_variance)
            if skid and solution.count == UNKNOWNS:
                skid += "; or one of the three sensors is faulty"
        return TwistEstimate(
            self._stamp_ns,
            solution.twist,
            covariance,
            True,
            readings,
            solution.assumed,
            skid,
            inflation,
            flows,
        )

    def _skid(self, axle: float, twist: FloatArray, covariance: FloatArray, variance: float) -> str:
        """Return a description of a skid; empty if the twist agrees with the constraint.

        Args:
            axle: position x of the axle without sideways slip [m].
            twist: twist of the sensors alone (v_x, v_y [m/s], yaw rate [rad/s]), shape (3,).
            covariance: covariance of this twist, shape (3, 3).
            variance: variance of the axle's sideways velocity while its wheels grip [m^2/s^2].
        """
        row = np.array([0.0, 1.0, axle])
        sideways = float(row @ twist)
        score = abs(sideways) / math.sqrt(max(float(row @ covariance @ row), 0.0) + variance)
        limit = self._configuration.contradiction_limit
        if limit == 0.0 or score <= limit:
            return ""
        return (
            f"the platform skids: its axle at x = {axle:g} m moves sideways at {sideways:.3g} m/s, "
            f"{score:.3g} standard deviations from the zero velocity of an axle that grips"
        )


def _tables(configuration: OdometryConfiguration, name: str) -> Path | None:
    """Return the file with the reference tables of a camera; None without such a file.

    Raises:
        ConfigurationError: the configured folder does not exist.
    """
    if not configuration.flat_field_tables:
        return None
    folder = Path(configuration.flat_field_tables).expanduser()
    if not folder.is_dir():
        raise ConfigurationError(
            "flat_field_tables",
            f"the folder {folder} does not exist; ./omni lines reference writes it",
        )
    file = folder / f"{name}.npz"
    return file if file.exists() else None
