"""Shortest known stop: optimal control with full knowledge of the vehicle.

The problem is transcribed into one nonlinear program, which IPOPT solves. The unknowns are the
brake torques, which are constant over an interval, and pose, twist and wheel speeds at the points
of a two-stage Radau rule. Wheel spin, slip and load transfer are modeled as in the simulator, but
with smooth functions. The tire's curve is a sine of an arctangent with the same slope, peak and
sliding force. The slip is the sliding velocity divided by ``sqrt(u^2 + smooth_speed^2)``, with the
rim speed ``u`` and `Transcription.smooth_speed`. Wheel loads and tire forces have no lag. The stop
ends at `Transcription.end_speed`, and the remaining distance is computed with the mean deceleration
of the stop.

A local optimum does not prove that no shorter stop exists. `bounds` computes a certified lower
bound. The true minimum is between this bound and the distance of the planned stop.
"""

import importlib
import math
from typing import Any, NamedTuple

import numpy as np

from omni_core.configuration import ConfigurationError
from omni_core.geometry import cross, turned
from omni_core.kinematics import PlatformKinematics
from omni_core.quantities import GRAVITY, FloatArray
from omni_runs.history import RunHistory
from omni_runs.limit import forces
from omni_runs.limit.stop_kinds import Maneuver
from omni_sim.tire.interface.model import curve_at
from omni_sim.tire.models import kernel_parameters
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.loads import load_plane

_SOLVER = {"print_level": 0, "max_iter": 400, "tol": 1e-6, "sb": "yes"}
# Radau IIA, two stages.
_STAGES = np.array([[5.0 / 12.0, -1.0 / 12.0], [0.75, 0.25]])


class Plan(NamedTuple):
    """A planned stop, described at the ends of M intervals.

    Attributes:
        distance: straight-line distance from start to rest [m]; NaN if no local optimum was found.
        rotation: change of heading [deg].
        time: times of the interval ends [s], shape (M + 1,).
        state: x, y of the center of gravity [m], yaw [rad], velocity in the body frame [m/s], yaw
            rate [rad/s], and wheel speeds, positive in their initial direction [rad/s],
            shape (M + 1, 6 + N).
        torque: torque of the brakes over the intervals [N m], shape (M, N).
    """

    distance: float
    rotation: float
    time: FloatArray
    state: FloatArray
    torque: FloatArray


class _Tire(NamedTuple):
    """Tire force at the load L: ``F = P(L) sin(C atan(B x - E (B x - atan B x)))``.

    Here ``P`` is the peak force, and ``x`` is the slip divided by the slip at the peak.

    Attributes:
        peak: coefficients of ``P(L)`` [N], a polynomial of the load [N], highest power first, shape
            (3,).
        peak_slip: coefficients of the slip at the peak [1], a polynomial of the load [N], highest
            power first, shape (2,).
        shape: the constants B, C and E of the formula [1].
    """

    peak: FloatArray
    peak_slip: FloatArray
    shape: tuple[float, float, float]


def load_casadi() -> Any:
    """Return the module of CasADi, a library that set-up does not install by default.

    Raises:
        ConfigurationError: CasADi is missing; the message explains how to install it.
    """
    try:
        return importlib.import_module("casadi")
    except ImportError as error:
        raise ConfigurationError("--best", "needs CasADi: ./omni install casadi") from error


class Transcription(NamedTuple):
    """Parameters of the nonlinear program that describes a stop.

    Attributes:
        intervals: number of intervals.
        end_speed: speed at which a stop ends [m/s].
        smooth_speed: minimum denominator of the slip, which makes the slip a smooth function [m/s].
        rise_time: time in which a brake rises from zero to full torque [s].
        released: rim speed below which a brake torque may have either sign, as that of a brake
            holding its wheel at rest [m/s].
        least_load: lower limit on the load of a wheel [N].
        smoothing: weight of torque changes in the objective; a positive weight makes the solution
            unique.
    """

    intervals: int = 50
    end_speed: float = 0.3
    smooth_speed: float = 0.3
    rise_time: float = 0.02
    released: float = 0.1
    least_load: float = 20.0
    smoothing: float = 1e-5


_USUAL = Transcription()


class OptimalStop:
    """Plans the shortest stops of a vehicle on even ground.

    Args:
        vehicle: vehicle that brakes.
        friction: friction factor of the ground [1].
        maneuver: motion at the start of braking; the pedal is fully down.
        program: parameters of the nonlinear program.
    """

    def __init__(
        self,
        vehicle: VehicleConfiguration,
        friction: float,
        maneuver: Maneuver,
        program: Transcription = _USUAL,
    ) -> None:
        self._casadi = load_casadi()
        self._program, self._intervals = program, program.intervals
        self._vehicle = vehicle
        self._geometry = PlatformKinematics(vehicle.wheels).geometry
        self._masses = vehicle.masses
        limit = forces.LimitVehicle(vehicle)
        self._friction = friction * limit.grip
        self._torque = vehicle.by_wheel("brake") * vehicle.brake.max_torque * maneuver.pedal
        self._tire = self._fit()
        self._start = self._start_of(maneuver)
        self._known: FloatArray | None = None
        self._transcribe()

    def plan(self, rotation: float, guess: RunHistory) -> Plan:
        """Return the shortest stop that the optimizer finds within a limit on the rotation.

        Args:
            rotation: limit on the change of heading [deg].
            guess: stop of any law that begins with the same motion. It is the initial value of the
                first plan; later plans start from the previous plan.
        """
        opti, solved = self._opti, False
        opti.set_value(self._allowed, math.radians(rotation))
        # The adaptive barrier strategy converges more often if the initial value is a run, the
        # monotone strategy if it is an optimum.
        for strategy in (
            ("adaptive", "monotone") if self._known is None else ("monotone", "adaptive")
        ):
            if self._known is None:
                self._start_from(guess)
            else:
                opti.set_initial(opti.x, self._known)
            opti.solver("ipopt", {"print_time": False}, {**_SOLVER, "mu_strategy": strategy})
            try:
                found, solved = opti.solve(), True
                self._known = found.value(opti.x)
                break
            except RuntimeError:  # raised by the solver if it finds no optimum
                found = opti.debug
        states = np.column_stack((self._start, found.value(self._ends)))
        return Plan(
            float(found.value(self._distance)) if solved else math.nan,
            math.degrees(abs(states[2, -1] - states[2, 0])),
            np.linspace(0.0, float(found.value(self._duration)), self._intervals + 1),
            states.T,
            (found.value(self._torques) * self._torque[:, None]).T,
        )

    def _start_from(self, guess: RunHistory) -> None:
        """Use a run, from its start of braking on, as the initial value of the optimization."""
        opti, first = self._opti, guess.brake_start or 0
        ends = np.linspace(0.0, 1.0, self._intervals + 1)
        points = np.sort(np.concatenate((ends[1:], ends[:-1] + np.diff(ends) / 3.0)))
        time = 1e-9 * (guess.stamp_ns[first:] - guess.stamp_ns[first])
        stopped = np.hypot(*guess.twist[first:, :2].T) < self._program.end_speed
        duration = float(time[max(int(np.argmax(stopped)), 2)])

        def at(share: FloatArray, values: FloatArray) -> FloatArray:
            return np.array([np.interp(share * duration, time, row) for row in values.T])

        body = np.vstack((at(points, guess.pose[first:]), at(points, guess.twist[first:])))
        rolling = self._sense[:, None] * at(points, guess.wheel_speed[first:])
        states = np.vstack((self._at_center(body), np.maximum(rolling, 0.0)))
        opti.set_initial(self._states, states / self._scale[:, None])
        acting = np.abs(at(ends[1:], guess.brake_torque[first:])) / self._torque[:, None]
        opti.set_initial(self._torques, np.minimum(acting, 1.0))
        opti.set_initial(self._loads, np.tile(self._standing[:, None], 2 * self._intervals) / 1e3)
        opti.set_initial(self._duration, duration)

    def _at_center(self, body: FloatArray) -> FloatArray:
        """Return pose and twist of the center of gravity, shape (6, K).

        Args:
            body: pose x, y, yaw of base_link in the world [m, m, rad], and its twist in the body
                frame [m/s, m/s, rad/s], shape (6, K).
        """
        x, y, yaw, v_x, v_y, rate = body
        c_x, c_y = self._masses.center
        a_x, a_y = turned(np.array((c_x, c_y)), yaw).T
        return np.array((x + a_x, y + a_y, yaw, v_x - rate * c_y, v_y + rate * c_x, rate))

    def _fit(self) -> _Tire:
        """Return a smooth model with the slope, peaks and sliding force of the vehicle's tire."""
        tire = self._vehicle.tire
        loads = np.linspace(0.05, 1.0, 20) * tire.largest_load
        curves = [curve_at(kernel_parameters(tire), float(load), 1.0) for load in loads]
        peak, slip = np.array([(curve.peak_force, curve.peak_slip) for curve in curves]).T
        slope = float(np.mean([c.slope * c.peak_slip / c.peak_force for c in curves]))
        slide = float(np.mean([c.slide_force / c.peak_force for c in curves]))
        shape = 2.0 - 2.0 / math.pi * math.asin(min(slide, 0.999))
        stiff = slope / shape
        bend = (stiff - math.tan(0.5 * math.pi / shape)) / (stiff - math.atan(stiff))
        return _Tire(
            np.append(np.polyfit(loads, peak / loads, 1), 0.0),
            np.polyfit(loads, slip, 1),
            (stiff, shape, bend),
        )

    def _start_of(self, maneuver: Maneuver) -> FloatArray:
        """Return the state (a row of `Plan.state`) at the start of braking, with rolling wheels.

        The rolling direction of each wheel is stored for the equations of motion.
        """
        geometry = self._geometry
        sliding = geometry.active @ maneuver.twist[:2] + maneuver.twist[2] * geometry.lever
        spin = sliding / geometry.rim
        self._sense = np.where(spin >= 0.0, 1.0, -1.0)
        self._lever = geometry.rim * self._sense
        body = self._at_center(np.concatenate((maneuver.pose, maneuver.twist)))
        return np.concatenate((body, np.abs(spin)))

    def _motion(self) -> Any:
        """Return CasADi's function for the equations of motion.

        Its arguments are the state (`Plan.state`), the brake torques [N m] and the wheel loads [N].
        It returns the time derivative of the state, and the difference between the given loads and
        the loads that balance the motion [N].
        """
        ca, masses = self._casadi, self._masses
        active, arm = self._geometry.active, self._geometry.position - self._masses.center
        swing, wheels = cross(arm, active), len(active)
        x, torque, load = ca.SX.sym("x", 6 + wheels), ca.SX.sym("t", wheels), ca.SX.sym("n", wheels)
        u, v, rate, spin = x[3], x[4], x[5], x[6:]
        hub = active[:, 0] * u + active[:, 1] * v + swing * rate
        rim = self._geometry.radius * spin
        slip = (hub - self._lever * spin) / ca.sqrt(rim**2 + self._program.smooth_speed**2)
        peak, peak_slip, (stiff, shape, bend) = self._tire
        strong = self._friction * (peak[0] * load**2 + peak[1] * load)
        b = stiff * slip / (self._friction * (peak_slip[0] * load + peak_slip[1]))
        force = -strong * ca.sin(shape * ca.atan(b - bend * (b - ca.atan(b))))
        a_x, a_y = (ca.dot(active[:, axis], force) / masses.mass for axis in range(2))
        plane, reach = load_plane(arm), -masses.height / GRAVITY
        share = plane[:, 0] + reach * (plane[:, 1] * a_x + plane[:, 2] * a_y)
        cos, sin = ca.cos(x[2]), ca.sin(x[2])
        twisted = ca.dot(swing, force) / masses.yaw_inertia
        spun = (-self._lever * force - torque) / self._vehicle.wheel_inertia
        path = (cos * u - sin * v, sin * u + cos * v, rate)
        moved = ca.vertcat(*path, a_x + rate * v, a_y - rate * u, twisted, spun)
        return ca.Function(
            "motion", [x, torque, load], [moved, load - masses.mass * GRAVITY * share]
        )

    def _transcribe(self) -> None:
        """Build the nonlinear program, whose parameter is the limit on the change of heading."""
        ca, count, start = self._casadi, self._intervals, self._start
        wheels, size = len(self._lever), len(start)
        speed = max(math.hypot(start[3], start[4]), 1.0)
        fastest = max(float(np.max(start[6:])), 1.0)
        self._scale = np.array((speed, speed, 1.0, speed, speed, 1.0, *([fastest] * wheels)))
        plane = load_plane(self._geometry.position - self._masses.center)
        self._standing = self._masses.mass * GRAVITY * plane[:, 0]
        self._opti = opti = ca.Opti()
        self._states = opti.variable(size, 2 * count)
        self._loads, self._torques = opti.variable(wheels, 2 * count), opti.variable(wheels, count)
        self._duration, self._allowed = opti.variable(), opti.parameter()
        states, share = ca.diag(self._scale) @ self._states, self._torques
        inner, ends = states[:, 0::2], states[:, 1::2]
        self._ends, h = ends, self._duration / count
        before = ca.horzcat(start, ends[:, :-1])
        motion, torque = self._motion().map(count), ca.diag(self._torque) @ share
        loads = 1e3 * self._loads
        rates = [motion(inner, torque, loads[:, 0::2]), motion(ends, torque, loads[:, 1::2])]
        for points, weights in zip((inner, ends), _STAGES, strict=True):
            step = h * (weights[0] * rates[0][0] + weights[1] * rates[1][0])
            opti.subject_to(ca.vec(ca.diag(1.0 / self._scale) @ (points - before - step)) == 0)
        for _, missing in rates:
            opti.subject_to(ca.vec(missing / 1e3) == 0)
        opti.subject_to(ca.vec(self._loads) >= self._program.least_load / 1e3)
        opti.subject_to(ca.vec(self._states[6:, :]) >= 0)
        rotation = ca.vec(states[2, :]) - start[2]
        opti.subject_to(rotation <= self._allowed)
        opti.subject_to(rotation >= -self._allowed)
        rim = ca.diag(self._geometry.radius / self._program.released) @ ends[6:, :]
        opti.subject_to(ca.vec(share + 1.0 / (1.0 + rim**2)) >= 0)
        opti.subject_to(opti.bounded(-1.0, ca.vec(share), 1.0))
        change = ca.horzcat(share[:, 0], share[:, 1:] - share[:, :-1])
        opti.subject_to(ca.vec(change) - h / self._program.rise_time <= 0)
        opti.subject_to(ca.vec(change) + h / self._program.rise_time >= 0)
        opti.subject_to(opti.bounded(0.05, self._duration, 30.0))
        last = ends[:, -1]
        reach = math.sqrt(self._masses.yaw_inertia / self._masses.mass)
        square = last[3] ** 2 + last[4] ** 2 + (reach * last[5]) ** 2
        opti.subject_to(square <= self._program.end_speed**2)
        self._distance = self._straight_distance(last) / (
            1.0 - (self._program.end_speed / speed) ** 2
        )
        opti.minimize(self._distance + self._program.smoothing * ca.sumsqr(change))

    def _straight_distance(self, last: Any) -> Any:
        """Return the straight-line distance [m] of base_link from its position at the start.

        Args:
            last: state of the vehicle, a row of `Plan.state`.
        """
        ca, (c_x, c_y) = self._casadi, self._masses.center

        def base(x: Any) -> tuple[Any, Any]:
            cos, sin = ca.cos(x[2]), ca.sin(x[2])
            return x[0] - cos * c_x + sin * c_y, x[1] - sin * c_x - cos * c_y

        (x, y), (x_0, y_0) = base(last), base(self._start)
        return ca.sqrt((x - x_0) ** 2 + (y - y_0) ** 2)
