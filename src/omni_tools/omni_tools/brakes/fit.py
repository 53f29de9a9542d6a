"""Fit of torque, dead time and lag of the brakes to recorded stops, without a tire model.

While a wheel turns under its brake, its speed ``omega`` gives the tire force. Let ``I`` be the
inertia of the wheel, ``T`` the torque of its brake and ``g = R cos(gamma)`` the lever (radius R,
roller angle gamma). Then ``I d(omega)/dt = g F - sign(omega) T`` yields the force ``F`` on the
vehicle along the roller's axis. The changes of momentum and angular momentum between two samples
then depend only on the brake torques and wheel speeds:

    sum_i a_i sign(omega_i) T p_i dt / g_i = d(m v_x, m v_y, J Omega) - sum_i a_i I d(omega_i) / g_i

with the mass ``m``, the yaw inertia ``J``, the velocity ``v`` and the yaw rate ``Omega``. Here
``a_i`` is the wrench of a unit force of wheel i about the center of gravity. The mean pressure
``p_i``, as a share of the full pressure, follows the command with dead time and first-order lag, in
closed form. The tire force of a locked or reversing wheel is unknown, so the equations are
projected onto the directions that such wheels cannot affect. The fit needs masses and the inertia
of the wheels, but neither wheel loads nor tires. The rolling radius of each wheel is estimated
before the pedal is pressed. It depends on the wheel load, which changes during braking. The
standard errors of the torques therefore include the differences between the radii of the wheels.

The equations of consecutive intervals in which the same wheels turn are summed. The error of a
measured speed then occurs in one row instead of in two rows with opposite signs.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from omni_core.configuration import WorkError
from omni_core.geometry import PlatformGeometry, cross, turned
from omni_core.kinematics import PlatformKinematics, require_omni_wheels
from omni_core.quantities import BoolArray, FloatArray, IntArray
from omni_runs.figures import style
from omni_sim.vehicle import configuration
from omni_tools.brakes.data import BrakeData, BrakeDataError

_SLOWEST = 0.5  # wheel speed below which a wheel counts as locked [rad/s]
_DEAD_TIMES = (0.0, 0.01, 0.03, 0.06, 0.1, 0.2)  # initial values of the search [s]
_TIME_CONSTANTS = (0.002, 0.01, 0.03, 0.08, 0.2)  # initial values of the search [s]
_SHORTEST = 1e-4  # lower limit on the time constant [s]
_FEWEST_INTERVALS = 10  # required number of intervals in which a braked wheel turns
_LARGEST_RESIDUAL = 0.3  # limit on the ratio of the residual to the changes of speed by braking [1]
_LARGEST_ERROR = 0.5  # limit on the ratio of the torque's standard error to the torque [1]
# An interval between two samples is omitted if it is at least this long [s].
_LONGEST_INTERVAL = 0.1
# Limit on the change of a radius by the tire's deflection, relative to the radius [1].
_LARGEST_DEFLECTION = 0.2


class BrakeFit(NamedTuple):
    """Torque, dead time and time constant of brakes, fitted to recorded stops.

    Attributes:
        values: torque with the pedal fully down [N m], dead time [s], time constant of the lag [s];
            shape (3,).
        standard_errors: standard errors of `values` [N m, s, s], NaN for a time at a bound of the
            search, shape (3,).
        wheel_torque: torque of each brake with the fitted times [N m], shape (N,).
        wheel_error: standard errors of `wheel_torque` [N m], NaN if not determined, shape (N,).
        residual: root mean square difference between fitted and measured changes of speed [m/s].
        intervals: number of intervals in which a braked wheel turned.
        stops: momentum equations of each recorded stop.
    """

    values: FloatArray
    standard_errors: FloatArray
    wheel_torque: FloatArray
    wheel_error: FloatArray
    residual: float
    intervals: int
    stops: tuple[StopEquations, ...]


class StopEquations(NamedTuple):
    """Momentum equations of a stop with K intervals and N wheels, divided by the vehicle's mass.

    Attributes:
        data: data of the stop.
        time: middle of each interval [s], shape (K,).
        step: length of each interval [s], shape (K,).
        lever_error: relative standard error of the mean lever arm of the brake forces [1].
        segment: number of the time span to which the interval belongs, shape (K,). Within a span,
            the same wheels turn.
        change: measured impulse of the brakes per mass, projected onto the directions that locked
            wheels cannot affect [m/s], shape (K, 3).
        per_torque: projected impulse per mass and per torque of each brake [m/s per N m], shape
            (K, 3, N).
    """

    data: BrakeData
    time: FloatArray
    step: FloatArray
    lever_error: float
    segment: IntArray
    change: FloatArray
    per_torque: FloatArray


def fit_brakes(stops: Sequence[BrakeData], vehicle: configuration.VehicleConfiguration) -> BrakeFit:
    """Fit one torque, one dead time and one time constant to all wheels of all stops.

    Args:
        stops: recorded stops.
        vehicle: vehicle, which gives masses, wheels and wheel inertia.

    Raises:
        BrakeDataError: too few intervals contain information on the brakes.
        UnusablePlatformError: a wheel is conventional.
        WorkError: the stops do not determine the brakes; the message states what is missing.
    """
    require_omni_wheels(vehicle.wheels, "the fit of the brakes")
    equations = tuple(_equations(stop, vehicle) for stop in stops)
    shown = [np.any(e.per_torque != 0.0, axis=(1, 2)) & _commanded(e) for e in equations]
    intervals = int(sum(np.count_nonzero(rows) for rows in shown))
    if intervals < _FEWEST_INTERVALS:
        raise BrakeDataError(
            f"a wheel turned under its brake in {intervals} intervals between two samples, and at "
            f"least {_FEWEST_INTERVALS} are needed: brake with less pedal, so that the wheels do "
            "not lock, or longer"
        )
    found = _search(equations)
    torque, dead_time, time_constant = found.x
    errors = _standard_errors(found.jac.reshape(-1, 3, 3), found.fun.reshape(-1, 3))
    lever_error = max(e.lever_error for e in equations)
    errors[0] = np.hypot(errors[0], lever_error * torque)
    errors[1:][np.array([dead_time, time_constant]) < 1.01 * _SHORTEST] = np.nan
    dead_time = 0.0 if dead_time < 1.01 * _SHORTEST else dead_time
    residual = float(np.sqrt(np.mean(found.fun**2)))
    size = float(np.sqrt(np.mean(_differences(equations, np.array([0.0, 0.0, 1.0])) ** 2)))
    if residual > _LARGEST_RESIDUAL * size:
        raise WorkError(
            f"the fitted brakes do not explain the stops: RMS error of {residual:.2g} m/s where "
            f"they changed the speed by {size:.2g} m/s (RMS); check that the recordings are of "
            "this vehicle, and brake with less pedal, so that the wheels do not lock"
        )
    if not errors[0] < _LARGEST_ERROR * torque:
        raise WorkError(
            f"the torque of {torque:.3g} N m is uncertain by {errors[0]:.2g} N m: record more "
            "stops, with the pedal halfway so that the wheels turn on under their brakes"
        )
    wheel_torque, wheel_error = _wheel_torques(equations, dead_time, time_constant)
    return BrakeFit(
        values=np.array([torque, dead_time, time_constant]),
        standard_errors=errors,
        wheel_torque=wheel_torque,
        wheel_error=np.hypot(wheel_error, lever_error * wheel_torque),
        residual=residual,
        intervals=intervals,
        stops=equations,
    )


def mean_shares(stop: StopEquations, dead_time: float, time_constant: float) -> FloatArray:
    """Return the mean pressure of each brake in each interval, as a share of the full pressure.

    Args:
        stop: equations of a stop, with its commands.
        dead_time: dead time of the brakes [s].
        time_constant: time constant of the brakes [s].

    Returns:
        Shares [1], shape (K, N).
    """
    tau = max(time_constant, _SHORTEST)
    changes = np.diff(stop.data.command, axis=0)
    news = np.any(changes != 0.0, axis=1)
    begins, changes = stop.data.command_time[1:][news] + dead_time, changes[news]

    def risen(time: FloatArray) -> FloatArray:
        """Return the time integral of the pressure's rise above its initial value [s], (K, N).

        The integral is computed up to each of the given times.
        """
        since = np.maximum(time[:, np.newaxis] - begins, 0.0)
        return np.asarray((since + tau * np.expm1(-since / tau)) @ changes)

    half = 0.5 * stop.step
    rise = risen(stop.time + half) - risen(stop.time - half)
    return np.asarray(stop.data.command[0] + rise / stop.step[:, np.newaxis])


def _commanded(stop: StopEquations) -> BoolArray:
    """Return whether the torque command of any brake is positive in each interval, shape (K,)."""
    row = np.searchsorted(stop.data.command_time, stop.time, side="right") - 1
    return np.asarray(np.any(stop.data.command[np.maximum(row, 0)] > 0.0, axis=1) & (row >= 0))


def _equations(stop: BrakeData, vehicle: configuration.VehicleConfiguration) -> StopEquations:
    """Return the momentum equations of a stop.

    Args:
        stop: data of the stop.
        vehicle: vehicle, which gives masses, wheels and wheel inertia.
    """
    masses = vehicle.masses
    geometry = PlatformGeometry.from_wheels(vehicle.wheels)
    arm = geometry.position - masses.center
    rolling = _rolling_share(stop, vehicle)
    lever = geometry.radius * rolling * np.cos(geometry.roller_angle)
    length = np.sqrt(masses.yaw_inertia / masses.mass)  # converts yaw rates to speeds
    wrench = np.column_stack((geometry.active, cross(arm, geometry.active) / length))
    wrench /= masses.mass

    step = np.diff(stop.time)
    # Velocity of the center of gravity at both ends of an interval, in axes with the mean heading
    # of this interval.
    yaw_rate = stop.twist[:, 2]
    velocity = stop.twist[:, :2] + yaw_rate[:, np.newaxis] * [-masses.center[1], masses.center[0]]
    half = 0.25 * (yaw_rate[1:] + yaw_rate[:-1]) * step
    change = turned(velocity[1:], half) - turned(velocity[:-1], -half)
    change = np.column_stack((change, length * np.diff(yaw_rate)))

    before, after = stop.wheel_speed[:-1], stop.wheel_speed[1:]
    turning = (before * after > 0.0) & (np.minimum(abs(before), abs(after)) > _SLOWEST)
    spin = vehicle.wheel_inertia * (after - before) / lever
    change -= np.where(turning, spin, 0.0) @ wrench
    factor = step[:, np.newaxis] * np.sign(before) * turning / lever
    per_torque = wrench.T * factor[:, np.newaxis, :]

    # Before the pedal is pressed, the drive also exerts torques.
    pressed = stop.time[:-1] >= _pedal_down(stop)
    for k in np.flatnonzero(~np.all(turning, axis=1)):
        unknown = wrench[~turning[k]].T
        basis, size, _ = np.linalg.svd(unknown, full_matrices=True)
        free = basis[:, np.count_nonzero(size > 1e-9 * size[0]) :]
        change[k], per_torque[k] = free @ (free.T @ change[k]), free @ (free.T @ per_torque[k])
    use = pressed & (step < _LONGEST_INTERVAL)
    return StopEquations(
        data=stop,
        time=0.5 * (stop.time[1:] + stop.time[:-1])[use],
        step=step[use],
        lever_error=float(np.std(rolling) / np.sqrt(rolling.size)),
        segment=np.cumsum(np.r_[True, np.any(turning[1:] != turning[:-1], axis=1)])[use],
        change=change[use],
        per_torque=per_torque[use],
    )


def _pedal_down(stop: BrakeData) -> float:
    asked = np.flatnonzero(np.any(stop.command > 0.0, axis=1))
    return float(stop.command_time[asked[0]]) if asked.size else np.inf


def _differences(equations: Sequence[StopEquations], unknowns: FloatArray) -> FloatArray:
    """Return the residuals: sums (`_summed`) of predicted minus measured impulse per mass [m/s].

    Args:
        equations: equations of the stops.
        unknowns: torque [N m], dead time [s] and time constant [s], shape (3,).
    """
    torque, dead_time, time_constant = unknowns
    parts = []
    for e in equations:
        shares = mean_shares(e, dead_time, time_constant)
        slowed = np.einsum("kcn,kn->kc", e.per_torque, shares) * torque
        parts.append(_summed(e, slowed - e.change))
    return np.concatenate(parts).ravel()


def _summed(stop: StopEquations, rows: FloatArray) -> FloatArray:
    """Return the cumulative sums of rows within each segment, minus the mean of these sums.

    The mean is subtracted because the error of the speed at the start of a segment is unknown.

    Args:
        stop: equations of a stop with K intervals, which gives the segments.
        rows: one row for each interval, shape (K, ...).

    Returns:
        Sums; k + 1 rows for a segment of k intervals, because the sums begin at zero.
    """
    sums = []
    for number in np.unique(stop.segment):
        steps = rows[stop.segment == number]
        path = np.cumsum(np.concatenate((np.zeros_like(steps[:1]), steps)), axis=0)
        sums.append(path - np.mean(path, axis=0))
    return np.concatenate(sums)


def _rolling_share(stop: BrakeData, vehicle: configuration.VehicleConfiguration) -> FloatArray:
    """Return the ratio of rolling to nominal radius of each wheel [1], shape (N,).

    The ratio is set to 1 if the wheel does not turn, or if the estimate differs from 1 by at least
    `_LARGEST_DEFLECTION` [1].
    """
    rolling = stop.time < _pedal_down(stop)
    expected = PlatformKinematics(vehicle.wheels).wheel_speeds(stop.twist)[rolling]
    found = np.sum(expected * stop.wheel_speed[rolling], axis=0)
    square = np.sum(stop.wheel_speed[rolling] ** 2, axis=0)
    share = np.divide(found, square, out=np.ones_like(found), where=square > _SLOWEST**2)
    plausible = abs(share - 1.0) < _LARGEST_DEFLECTION
    return np.asarray(np.where(plausible, share, 1.0))


def _search(equations: Sequence[StopEquations]) -> Any:
    """Return the result of SciPy's least-squares search from the best point of a grid."""
    # Imported here, because only fits need this slow import.
    from scipy.optimize import least_squares

    def start(times: tuple[float, float]) -> tuple[float, float, float, float]:
        """Return the smallest sum of squared residuals, its torque, and the given times."""
        nothing = _differences(equations, np.array([0.0, *times]))
        one = _differences(equations, np.array([1.0, *times])) - nothing
        torque = max(-float(one @ nothing) / max(float(one @ one), 1e-300), 0.0)
        return float(np.sum((nothing + torque * one) ** 2)), max(torque, 1e-6), *times

    grid = itertools.product(_DEAD_TIMES, _TIME_CONSTANTS)
    _, torque, dead_time, time_constant = min(map(start, grid))
    return least_squares(
        lambda unknowns: _differences(equations, unknowns),
        (torque, max(dead_time, 1e-4), time_constant),
        jac="3-point",
        bounds=((0.0, 0.0, _SHORTEST), (np.inf, 1.0, 10.0)),
        x_scale=(torque, 0.01, 0.01),
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
    )


def _standard_errors(jacobian: FloatArray, left: FloatArray) -> FloatArray:
    """Return standard errors of P unknowns that also hold for correlated residuals, shape (P,).

    The variance of an unknown is the sum of the autocovariances of the rows' contributions to this
    unknown, from lag zero up to the first lag at which they are not positive (White 1980, Bartlett
    1946). Independent residuals have an autocovariance only at lag zero.

    Args:
        jacobian: derivatives of the residuals with respect to the unknowns, shape (K, 3, P).
        left: residuals [m/s], shape (K, 3).
    """
    rows, _, unknowns = jacobian.shape
    bread = np.linalg.pinv(np.einsum("kcp,kcq->pq", jacobian, jacobian))
    variance = np.zeros(unknowns)
    for unknown, moved in enumerate(bread @ np.einsum("kcp,kc->pk", jacobian, left)):
        variance[unknown] = moved @ moved
        for lag in range(1, rows // 4):
            covariance = moved[lag:] @ moved[:-lag]
            if covariance <= 0.0:
                break
            variance[unknown] += 2.0 * covariance
    return np.asarray(np.sqrt(variance * left.size / max(left.size - unknowns, 1)))


def _wheel_torques(
    equations: Sequence[StopEquations], dead_time: float, time_constant: float
) -> tuple[FloatArray, FloatArray]:
    """Return a separate torque for each brake, for a given dead time and time constant.

    Args:
        equations: equations of the stops.
        dead_time: dead time of all brakes [s].
        time_constant: time constant of all brakes [s].

    Returns:
        Torques [N m], shape (N,); standard errors [N m], shape (N,). All are NaN if the stops do
        not determine a torque for each wheel.
    """
    columns = np.concatenate(
        [
            _summed(e, e.per_torque * mean_shares(e, dead_time, time_constant)[:, np.newaxis])
            for e in equations
        ]
    )
    change = np.concatenate([_summed(e, e.change) for e in equations])
    n = columns.shape[2]
    flat = columns.reshape(-1, n)
    torque, error = np.full(n, np.nan), np.full(n, np.nan)
    # Only three accelerations are measured, so four torques may be impossible to determine.
    size = np.linalg.svd(flat, compute_uv=False)
    if size[-1] > 1e-3 * size[0]:
        torque = np.linalg.lstsq(flat, change.ravel(), rcond=None)[0]
        error = _standard_errors(columns, (flat @ torque).reshape(-1, 3) - change)
    return torque, error


def brake_figure(fit: BrakeFit, names: list[str], title: str) -> Figure:
    """Draw the measured and the fitted changes of speed, and the response of one brake.

    Args:
        fit: fit of the stops.
        names: names of the recordings, in the order of the stops.
        title: title of the figure.
    """
    x = "Time since the valve opened [ms]"
    y = ("Speed loss while\nwheels turn [m/s]", "Measured -\nfitted [mm/s]", "Torque [N m]")
    figure, ((upper,), (middle,), (lower,)) = style.panels(
        title, 3, size=(9.0, 7.4), x=x, y=y, height_ratios=(3.0, 1.2, 1.8)
    )
    torque, dead_time, time_constant = fit.values
    for index, (stop, name) in enumerate(zip(fit.stops, names, strict=True)):
        shares = mean_shares(stop, dead_time, time_constant)
        explained = np.einsum("kcn,kn->kc", stop.per_torque, shares) * torque
        time = stop.time - stop.time[0]
        taken = np.cumsum(np.stack((stop.change, explained)), axis=1)
        main = int(np.argmax(np.abs(taken[0, -1])))
        color = style.wheel_color(index)
        measured, fitted = np.abs(taken[:, :, main])
        upper.plot(time, measured, color=color, marker="o", markersize=2.5, linestyle="none")
        upper.plot(time, fitted, color=color, label=name)
        middle.plot(time, 1e3 * (measured - fitted), color=color, linewidth=1.0)
    middle.axhline(0.0, color=style.BLACK, linewidth=1.0)
    after = np.linspace(0.0, dead_time + 5.0 * time_constant + 0.02, 300)
    since = np.maximum(after - dead_time, 0.0)
    answer = torque * -np.expm1(-since / max(time_constant, 1e-6))
    lower.plot(1e3 * after, answer, color=style.BLACK)
    for axes in (upper, middle):
        axes.set_xlabel("Time since the start of braking [s]")
    upper.legend(loc="lower right")
    return figure
