"""Constants, inputs and state of a vehicle's kernels, with named fields.

The state is stored in structured arrays, so that a kernel reads ``wheel.speed`` and Python code
reads ``wheels["speed"]``. Constants and inputs are NamedTuples.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omni_core.kernels import by_reference
from omni_core.quantities import BoolArray, FloatArray, IntArray, Pair, Triple
from omni_sim.ground.configuration import Terrain
from omni_sim.wheel.brake_pressure import BrakePressure
from omni_sim.wheel.configuration import Motor

Structured = NDArray[np.void]
Record = Any
"""Reference to a record of a structured array."""


def _floats(*names: str, flag: str = "") -> np.dtype[np.void]:
    """Return a record type with a double for each name and, if `flag` is not empty, a bool."""
    flags = [(flag, np.bool_)] if flag else []
    return np.dtype([*((name, np.float64) for name in names), *flags], align=True)


BODY = _floats("x", "y", "yaw", "v_x", "v_y", "yaw_rate", "a_x", "a_y", "tilt_x", "tilt_y")
"""State of the body. Yaw and velocity are given in the path plane (`uneven_ground`).

    x, y             position of the center of gravity in the world frame [m]
    yaw              heading [rad]
    v_x, v_y         velocity of the center of gravity in the world frame [m/s]
    yaw_rate         yaw rate [rad/s]
    a_x, a_y         acceleration by the tires in the body frame, low-pass filtered [m/s^2]
    tilt_x, tilt_y   horizontal components of the path plane's normal [1]
"""

CONTACT = _floats("r_x", "r_y", "n_x", "n_y", "moment", "rim")
"""Contact of a wheel, in the body frame.

    r_x, r_y   position ``r_i - r_g`` relative to the center of gravity [m]
    n_x, n_y   active direction ``n_w`` [1]
    moment     lever of the active direction, ``cross(r_i - r_g, n_w)`` [m]
    rim        ``n_w . u`` with the rolling direction ``u`` of the wheel [1]
"""

WHEEL = _floats(
    *("speed", "angle", "deflection", "force", "load", "brake", "command", "slip", "limit"),
    *("passive", "gain", "last_speed", "motor"),
    flag="sliding",
)
"""State of a wheel; the fields from `load` on describe the last step.

    speed        rotational speed [rad/s]
    angle        rotation [rad]
    deflection   deflection ``e`` of the tire [m]
    force        force on the vehicle along the active direction [N]
    load         wheel load [N]
    brake        torque of the brake on the wheel [N m]
    command      speed command of a velocity drive that brakes [rad/s]
    slip         slip of the contact patch, Eq. (20) [1]
    limit        limit on the force at this load and ground [N]
    passive      force of the passive losses on the vehicle [N]
    gain         wheel speed that the passive losses add in a step [rad/s]
    last_speed   wheel speed before the step, used only with passive losses [rad/s]
    motor        torque of the drive on the wheel [N m]
    sliding      whether the contact patch slides
"""

LOSS = _floats("u_x", "u_y", "moment", "rim", "mobility")
"""Constants of a wheel's passive losses, in the body frame.

    u_x, u_y   passive direction ``u_w`` [1]
    moment     lever of the passive direction, ``cross(r_i - r_g, u_w)`` [m]
    rim        ``u_w . u`` with the rolling direction ``u`` of the wheel [1]
    mobility   sum of the absolute mobilities that couple the roller to all forces [1/kg]
"""

ROLLER = _floats(
    *("spin", "e_a", "e_p", "f_a", "f_p", "q_a", "q_p", "load", "limit", "slip", "torque"),
    flag="sliding",
)
"""State of a roller; fields with ``_a`` are components along its axis, and with ``_p`` across it.

    spin       rotational speed [rad/s]
    e_a, e_p   deflection of the tread [m]
    f_a, f_p   force on the vehicle [N]
    q_a, q_p   unit vector of the friction [1]
    load       load [N]
    limit      limit on the friction [N]
    slip       slip [1]
    torque     torque on the wheel [N m]
    sliding    whether the contact patch slides
"""

CHASSIS = _floats("heave", "forward", "left", "heave_rate", "forward_rate", "left_rate")
"""State of a sprung chassis relative to the vehicle's plane.

    heave         height ``z`` of `suspension` [m]
    forward       gradient ``p`` forward [1]
    left          gradient ``r`` to the left [1]
    heave_rate    time derivative of the height [m/s]
    forward_rate  time derivative of the gradient forward [1/s]
    left_rate     time derivative of the gradient to the left [1/s]
"""

COUNTERS = np.dtype([("tipping_steps", np.int64), ("overloaded_steps", np.int64)])
"""Counters: steps in which the vehicle tips, and sum of the overloaded wheels over all steps."""


@by_reference
class Plant(NamedTuple):
    """Constants of a vehicle's kernel.

    Attributes:
        dt: physics step [s].
        mass: mass m of the vehicle [kg].
        yaw_inertia: moment of inertia J about the center of gravity [kg m^2].
        center: center of gravity in the body frame [m].
        filter_share: weight of the newest acceleration in the low-pass filter [1].
        contact: nominal contacts of the wheels, `CONTACT`, shape (N,).
        radius: radius of the unloaded wheels [m], shape (N,).
        mobility: sum W of the absolute mobilities of each wheel, see `dynamics` [1/kg], shape (N,).
        rolling: wheel speeds per unit of body twist, Eq. (32), shape (N, 3).
        position: position of the wheels relative to the center of gravity [m], shape (N, 2).
        plane: matrix from `loads.load_plane`, shape (N, 3).
        hull: indices of the wheels from `masses.support_polygon`.
        wheel_inertia: moment of inertia I of a wheel about its axis [kg m^2].
        motor: motor of each drive.
        drive_power: limit on the power of a drive that follows its command [W].
        drive_stiffness: stiffness of a velocity drive that brakes [N m s/rad].
        ramp: rate at which a velocity drive reduces its speed command, divided by the demanded
            brake torque [rad/s^2 per N m]; 0 for friction brakes, shape (N,).
        tire: constants of the tire model; their type determines the model.
        largest_load: load to which higher wheel loads are limited [N].
        stiffness: horizontal stiffness c_x of a tire [N/m].
        damping: horizontal damping d_x of a tire [N s/m].
        vertical_stiffness: vertical stiffness c_z of a tire [N/m].
        slip_speed: speed v_num that keeps the slip of a locked wheel finite [m/s].
        friction: friction factor of the ground outside the patches [1].
        patches: table of the patches from `friction.FrictionMap`, shape (P, 8).
        grip: factor by which the friction under each wheel is multiplied [1], shape (N,).
        brake_share: factor by which the torque of each wheel's brake is multiplied [1], shape (N,).
        brake_power: limit on the power of a wheel's brake [W].
        rollers: geometry of even and odd rollers, `roller_geometry.AXIS`, shape (N, 2); shape (0,
            2) if the contacts remain under the wheels.
        roller_pitch: angle between two rollers [rad]; 0 if the contacts remain under the wheels.
    """

    dt: float
    mass: float
    yaw_inertia: float
    center: Pair
    filter_share: float
    contact: Structured
    radius: FloatArray
    mobility: FloatArray
    rolling: FloatArray
    position: FloatArray
    plane: FloatArray
    hull: IntArray
    wheel_inertia: float
    motor: Motor
    drive_power: float
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


@by_reference
class Losses(NamedTuple):
    """Constants of the losses along the passive directions.

    Attributes:
        wheel: constants of each wheel, records of `LOSS`, shape (N,); shape (0,) without losses.
        constant: ratio of friction to load at a small load [1].
        growing: increase of this ratio per unit of load, Eq. (19) [1/N].
        inertia: moment of inertia of a roller divided by its squared radius [kg].
        quadratic: increase of the ratio per squared speed of the roller's surface [s^2/m^2].
    """

    wheel: Structured
    constant: float
    growing: float
    inertia: float
    quadratic: float


@by_reference
class Rollers(NamedTuple):
    """Individual rollers of all wheels: their state, and constants in addition to `Plant`.

    Attributes:
        tire_y: constants of the tire model across the roller's axis.
        inertia: moment of inertia of even and odd rollers about their axes [kg m^2], shape (2,).
        stiffness: stiffness of a roller's tread [N/m].
        damping: damping of a roller's tread [N s/m].
        overlap: overlap of neighboring rollers, `RollerConfiguration.overlap` [1].
        constant: friction force at a roller's surface divided by the load, at a small load [1].
        growing: increase of this ratio per unit of load, Eq. (19) [1/N].
        quadratic: increase of the ratio per squared speed of the roller's surface [s^2/m^2].
        state: state of the n rollers of each wheel, `ROLLER`, shape (N, n).
        push: force [N] and moment about the center of gravity [N m] of each wheel in the last step,
            and the sums of load times displacement of its contacts [N m], body frame, shape (N, 5).
    """

    tire_y: Any
    inertia: FloatArray
    stiffness: float
    damping: float
    overlap: float
    constant: float
    growing: float
    quadratic: float
    state: Structured
    push: FloatArray


@by_reference
class Treads(NamedTuple):
    """Contacts of conventional wheels: their state, and constants in addition to `Plant`.

    Attributes:
        conventional: whether each wheel is conventional, shape (N,).
        tire_y: constants of the tire model along the wheel's axis.
        state: state of the contacts, records of `ROLLER` with a spin of 0, whose components ``_a``
            are along the active direction and ``_p`` along the wheel's axis, shape (N,).
        push: force [N] and moment about the center of gravity [N m] of each wheel in the last step,
            body frame, shape (N, 3).
        steering: steering of the wheels, records of `wheel.steering.STEERING`, shape (N,).
        lateral: lateral velocity that the drives follow, per unit of the commanded twist
            [1, 1, m]; see `steering`.
    """

    conventional: BoolArray
    tire_y: Any
    state: Structured
    push: FloatArray
    steering: Structured
    lateral: Triple


@by_reference
class Suspension(NamedTuple):
    """Suspension of a chassis; see the module `suspension`.

    Attributes:
        stiffness: vertical stiffness c of each wheel [N/m]; 0 if there is no suspension.
        damping: vertical damping d of each wheel [N s/m].
        pitch_inertia: moment of inertia I_p about the lateral axis [kg m^2].
        roll_inertia: moment of inertia I_r about the longitudinal axis [kg m^2].
        mounted: mounting height of each wheel relative to the other wheels [m], shape (N,).
        half_gap: distance along the rim from the end of a roller to the middle of the gap to the
            next roller [m].
        ground: height of the ground under each wheel above the vehicle's plane [m], shape (N,).
        sunk: depth by which each wheel sinks into a gap between rollers [m], shape (N,).
        chassis: state of the chassis, a record of `CHASSIS`, shape (1,).
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


@by_reference
class State(NamedTuple):
    """Constants and state of a vehicle; the arrays are changed in place.

    Attributes:
        plant: constants.
        terrain: height of the ground.
        losses: losses along the passive directions.
        suspension: suspension of the chassis.
        body: a record of `BODY`, shape (1,).
        contacts: records of `CONTACT` in the last step, shape (N,); they change only if wheels are
            steered, or if `Plant.roller_pitch` is not 0 and the wheels have no individual rollers.
        rollers: individual rollers, or None; the kernels are compiled for both cases.
        treads: contacts of the wheels of a vehicle with conventional wheels, or None; the kernels
            are compiled for both cases.
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
    treads: Treads | None
    wheels: Structured
    counters: Structured
    pressure: BrakePressure
    loads: FloatArray


class Control(NamedTuple):
    """Inputs of the vehicle, which are constant during a call of the kernel.

    Attributes:
        brake: torque of a brake whose valve passes the whole pressure of the pedal [N m].
        enable: commanded share of the pressure that each valve passes [1], shape (N,).
        drive_stiffness: stiffness of the drives' clutches [N m s/rad], 0 when disengaged.
        twist: commanded body twist at the start of the call [m/s, m/s, rad/s], shape (3,).
        in_world: whether the commanded velocity keeps its direction in the world while the body
            turns.
        force_x: constant force at the center of gravity along x of the world [N].
        force_y: constant force at the center of gravity along y of the world [N].
        moment: constant moment about the center of gravity [N m].
        height: height of the center of gravity [m].
    """

    brake: float
    enable: FloatArray
    drive_stiffness: float
    twist: FloatArray
    in_world: bool
    force_x: float
    force_y: float
    moment: float
    height: float


class Step(NamedTuple):
    """Quantities of a physics step that are equal for all wheels.

    Attributes:
        place: position of the center of gravity in the world at the middle of the step [m].
        heading: cosine and sine of the yaw at the middle of the step.
        tilt: horizontal components of the path plane's normal [1].
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


class Energies(NamedTuple):
    """Kinetic, elastic and potential energies of a vehicle [J].

    Attributes:
        translation: kinetic energy of the center of gravity.
        rotation: kinetic energy of the rotation of the body about its center of gravity.
        spin: kinetic energy of the spin of wheels and individual rollers.
        elastic: elastic energy of the tires' deflection.
        height: potential energy ``m g Z`` relative to the level z = 0.
    """

    translation: float
    rotation: float
    spin: float
    elastic: float
    height: float
