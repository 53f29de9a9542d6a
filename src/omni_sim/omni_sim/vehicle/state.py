"""Constants, inputs and state of the kernels of a vehicle, by name.

State is in structured arrays, so that a kernel reads ``wheel.speed`` and Python
``wheels["speed"]``; constants and inputs are NamedTuples.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_platform.quantities import FloatArray, IntArray, Pair, Triple
from omni_sim.ground.elevation import Terrain
from omni_sim.wheel.brake_pressure import BrakePressure

Structured = NDArray[np.void]
Record = Any
"""One entry of a structured array, by reference."""


def _floats(*names: str) -> np.dtype[np.void]:
    return np.dtype([(name, np.float64) for name in names])


BODY = _floats("x", "y", "yaw", "v_x", "v_y", "yaw_rate", "a_x", "a_y", "tilt_x", "tilt_y")
"""The body: position of the center of gravity and its velocity in the world frame [m, rad, m/s,
rad/s], the low-passed acceleration by the tires in the body frame [m/s^2], and the level components
of the path plane's normal [1], in whose frame yaw and velocity are."""

CONTACT = _floats("r_x", "r_y", "n_x", "n_y", "moment", "rim")
"""Contact of a wheel: position relative to the center of gravity [m], active direction ``n_w`` [1],
``cross(r_i - r_g, n_w)`` [m], ``n_w . u`` [1]."""

WHEEL = np.dtype(
    [
        ("speed", np.float64),
        ("angle", np.float64),
        ("deflection", np.float64),
        ("force", np.float64),
        ("load", np.float64),
        ("brake", np.float64),
        ("command", np.float64),
        ("slip", np.float64),
        ("limit", np.float64),
        ("passive", np.float64),
        ("gain", np.float64),
        ("last_speed", np.float64),
        ("sliding", np.bool_),
    ],
    align=True,
)
"""A wheel: speed [rad/s], angle [rad], deflection ``e`` of the tire and its force on the vehicle
along the active direction [m, N], and of the last step the load [N], the torque of the brake on the
wheel [N m], the speed command of a velocity drive that brakes [rad/s], the slip of the patch (20)
[1] and the largest force that load and ground allowed [N]. With passive losses: their force on the
vehicle [N], the speed that they add to the wheel in a step and the wheel speed before the last step
[rad/s]. Last, whether the patch slides."""

LOSS = _floats("u_x", "u_y", "moment", "rim", "mobility")
"""Constants of a wheel's passive losses: passive direction ``u_w`` [1], ``cross(r_i - r_g, u_w)``
[m], ``u_w . u`` [1], sum of the absolute mobilities that couple the roller to any force [1/kg]."""

ROLLER = np.dtype(
    [
        ("spin", np.float64),
        ("e_a", np.float64),
        ("e_p", np.float64),
        ("f_a", np.float64),
        ("f_p", np.float64),
        ("q_a", np.float64),
        ("q_p", np.float64),
        ("load", np.float64),
        ("limit", np.float64),
        ("slip", np.float64),
        ("torque", np.float64),
        ("sliding", np.bool_),
    ],
    align=True,
)
"""A roller: spin [rad/s]; deflection [m], force [N] and direction of the friction [1] along its
axis (active) and across it (passive); the load that it carries and the friction limit [N]; slip
[1]; its torque on the wheel [N m]; whether it slides."""

CHASSIS = _floats("heave", "forward", "left", "heave_rate", "forward_rate", "left_rate")
"""A sprung chassis over the vehicle's plane: ``z`` [m], gradients ``p`` and ``r`` [1], and their
rates [m/s, 1/s, 1/s]."""

COUNTERS = np.dtype([("tipping_steps", np.int64), ("overloaded_steps", np.int64)])
"""Steps with tipping, and wheel-steps beyond the tire's largest load."""


class Plant(NamedTuple):
    """Constants of a run.

    Attributes:
        dt: physics step [s].
        mass: mass m of the vehicle [kg].
        yaw_inertia: moment of inertia J about the center of gravity [kg m^2].
        center: center of gravity in the body frame [m].
        height: height of the center of gravity [m].
        filter_share: weight of the newest acceleration in the low-pass [1].
        contact: nominal contacts of the wheels, `CONTACT`, shape (N,).
        radius: radius of the unloaded wheels [m], shape (N,).
        mobility: W of each wheel, see `dynamics` [1/kg], shape (N,).
        rolling: wheel speeds per unit of body twist, Eq. (32), shape (N, 3).
        position: position of the wheels from the center of gravity [m], shape (N, 2).
        plane: load plane from `loads.load_plane`, shape (N, 3).
        hull: indices of the wheels from `loads.support_polygon`.
        wheel_inertia: moment of inertia I of a wheel about its axis [kg m^2].
        drive_limit: largest torque of a clutch [N m].
        drive_stiffness: stiffness of a velocity drive that brakes [N m s/rad].
        ramp: deceleration of a velocity drive's speed command per torque of a brake [rad/s^2 per
            N m], 0 for friction brakes, shape (N,).
        tire: constants of the tire model; their type chooses it.
        largest_load: load to which the tire's load is clamped [N].
        stiffness: horizontal stiffness c_x of a tire [N/m].
        damping: horizontal damping d_x of a tire [N s/m].
        vertical_stiffness: vertical stiffness c_z of a tire [N/m].
        slip_speed: speed v_num that keeps the slip finite [m/s].
        friction: friction factor of the ground outside the patches [1].
        patches: table of the patches from `friction.FrictionMap`, shape (P, 8).
        grip: factor on the friction under each wheel [1], shape (N,).
        brake_share: factor on the torque of each wheel's brake [1], shape (N,).
        brake_power: largest power of a wheel's brake [W].
        rollers: geometry of the rollers, `roller_geometry.AXIS`, shape (N,).
        roller_pitch: angle between two rollers [rad]; 0 if the contacts stay under the wheels.
    """

    dt: float
    mass: float
    yaw_inertia: float
    center: Pair
    height: float
    filter_share: float
    contact: Structured
    radius: FloatArray
    mobility: FloatArray
    rolling: FloatArray
    position: FloatArray
    plane: FloatArray
    hull: IntArray
    wheel_inertia: float
    drive_limit: float
    drive_stiffness: float
    ramp: FloatArray
    tire: Any
    largest_load: float
    stiffness: float
    damping: float
    vertical_stiffness: float
    slip_speed: float
    friction: float
    patches: FloatArray
    grip: FloatArray
    brake_share: FloatArray
    brake_power: float
    rollers: Structured
    roller_pitch: float


class Losses(NamedTuple):
    """Losses along the passive directions.

    Attributes:
        wheel: constants of the wheels, `LOSS`, shape (N,); shape (0,) without losses.
        constant: friction per load [1].
        growing: friction per load and load, Eq. (19) [1/N].
        inertia: inertia of a roller against its surface speed [kg].
    """

    wheel: Structured
    constant: float
    growing: float
    inertia: float


class Rollers(NamedTuple):
    """The individual rollers of all wheels: constants in addition to `Plant`, and state.

    Attributes:
        tire_y: constants of the tire model in the direction y.
        inertia: inertia of a roller [kg m^2].
        stiffness: stiffness of a roller's tread [N/m].
        damping: damping of a roller's tread [N s/m].
        overlap: see `roller_configuration.RollerConfiguration`.
        constant: friction against a roller's rotation, at its surface, per load [1].
        growing: increase of this value per load, Eq. (19) [1/N].
        state: state of the rollers, `ROLLER`, shape (N, n).
        push: forces [N] and moment about the center of gravity [N m] of each wheel in the last
            step, body frame, shape (N, 3).
    """

    tire_y: Any
    inertia: float
    stiffness: float
    damping: float
    overlap: float
    constant: float
    growing: float
    state: Structured
    push: FloatArray


class Suspension(NamedTuple):
    """The springs of a chassis; see `suspension`.

    Attributes:
        stiffness: vertical stiffness c of each wheel [N/m]; 0 without suspension.
        damping: vertical damping d of each wheel [N s/m].
        pitch_inertia: moment of inertia I_p about the lateral axis [kg m^2].
        roll_inertia: moment of inertia I_r about the longitudinal axis [kg m^2].
        mounted: mounting height of each wheel relative to the others [m], shape (N,).
        half_gap: half gap from a roller's end to the middle of the gap between two, along the rim
            [m].
        ground: height under each wheel over the vehicle's plane [m], shape (N,).
        sunk: depth of each wheel in a gap between rollers [m], shape (N,).
        chassis: `CHASSIS`, shape (1,).
    """

    stiffness: float
    damping: float
    pitch_inertia: float
    roll_inertia: float
    mounted: FloatArray
    half_gap: float
    ground: FloatArray
    sunk: FloatArray
    chassis: Structured


class State(NamedTuple):
    """Constants and state of a vehicle; the arrays are changed in place.

    Attributes:
        plant: constants.
        terrain: height of the ground.
        losses: losses along the passive directions.
        suspension: suspension of the chassis.
        body: a record of `BODY`, shape (1,).
        contacts: records of `CONTACT` in the last step, shape (N,); they change only if
            `Plant.roller_pitch` is not 0 and the rollers are not individual ones.
        rollers: individual rollers, or None; kernels are compiled for both cases.
        wheels: records of `WHEEL`, shape (N,).
        counters: a record of `COUNTERS`, shape (1,).
        pressure: pressure in the brakes.
        loads: loads of the wheels in the current step [N], shape (N,).
    """

    plant: Plant
    terrain: Terrain
    losses: Losses
    suspension: Suspension
    body: Structured
    contacts: Structured
    rollers: Rollers | None
    wheels: Structured
    counters: Structured
    pressure: BrakePressure
    loads: FloatArray


class Control(NamedTuple):
    """Inputs of the vehicle during a call.

    Attributes:
        brake: torque of a brake at the full pressure of the pedal [N m].
        enable: commanded share of the pressure that each valve passes [1], shape (N,).
        drive_stiffness: stiffness of the drives' clutches [N m s/rad], 0 when disengaged.
        twist: commanded body twist at the start of the call [m/s, m/s, rad/s], shape (3,).
        in_world: whether the commanded velocity keeps its direction in the world while the body
            turns.
        force_x: constant force at the center of gravity along x of the world [N].
        force_y: constant force at the center of gravity along y of the world [N].
    """

    brake: float
    enable: FloatArray
    drive_stiffness: float
    twist: FloatArray
    in_world: bool
    force_x: float
    force_y: float


class Step(NamedTuple):
    """Quantities of a physics step common to all wheels.

    Attributes:
        place: center of gravity in the world at the middle of the step [m].
        heading: cosine and sine of the yaw at the middle of the step.
        tilt: level components of the path plane's normal [1].
        ahead: velocity of the center of gravity [m/s] and yaw rate [rad/s] at the end of the step
            if the forces did not change, in the body frame.
        drive: commanded twist in the body frame [m/s, m/s, rad/s].
        drive_stiffness: stiffness of the drives' clutches [N m s/rad], 0 when disengaged.
    """

    place: Pair
    heading: Pair
    tilt: Pair
    ahead: Triple
    drive: Triple
    drive_stiffness: float


class Log(NamedTuple):
    """Log of n steps.

    Attributes:
        steps: number of steps n.
        trajectory: x, y [m], yaw [rad], v_x, v_y [m/s], yaw rate [rad/s] of base_link in the world
            frame at the start and after each step, shape (n + 1, 6); (0, 6) if not recorded.
        wheels: records of `WHEEL` after each step, shape (n, N); (0, N) if not recorded.
        energy: `Energies` after each step [J], shape (n, 5); (0, 5) if not recorded.
    """

    steps: int
    trajectory: FloatArray
    wheels: Structured
    energy: FloatArray

    @classmethod
    def of(cls, n_steps: int, n_wheels: int, *, traced: bool, logged: bool) -> Log:
        """Return an empty log for a number of steps, with the columns that are to be recorded."""
        rows = n_steps if logged else 0
        return cls(
            n_steps,
            np.empty((n_steps + 1 if traced else 0, 6)),
            np.empty((rows, n_wheels), WHEEL),
            np.empty((rows, 5)),
        )


class Energies(NamedTuple):
    """Energies of a vehicle [J].

    Attributes:
        translation: kinetic energy of the center of gravity.
        rotation: kinetic energy of the rotation of the body about its center of gravity.
        spin: kinetic energy of the spin of wheels and individual rollers.
        elastic: elastic energy of the tires' deflection.
        height: potential energy ``m g Z`` over the level z = 0.
    """

    translation: float
    rotation: float
    spin: float
    elastic: float
    height: float

    @property
    def kinetic(self) -> float:
        """Sum of the energies of translation, rotation and spin [J]."""
        return self.translation + self.rotation + self.spin
