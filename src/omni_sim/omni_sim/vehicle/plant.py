"""Conversion of a vehicle's configuration to the state of the dynamics kernel."""

import math
from collections.abc import Sequence

import numpy as np

from omni_core.geometry import PlatformGeometry, cross
from omni_core.kinematics import PlatformKinematics
from omni_core.quantities import GRAVITY, FloatArray
from omni_sim.ground.configuration import ElevationConfiguration
from omni_sim.ground.friction import FrictionMap
from omni_sim.masses import support_polygon
from omni_sim.tire.combined_slip import passive_parameters
from omni_sim.tire.models import kernel_parameters
from omni_sim.vehicle import state
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.loads import load_plane, wheel_loads
from omni_sim.wheel.brake_pressure import build_brake_pressure
from omni_sim.wheel.roller_geometry import AXIS, RollerGeometry
from omni_sim.wheel.steering import build_steering


def build_state(
    configuration: VehicleConfiguration,
    friction: FrictionMap,
    physics_step: float,
    elevation: ElevationConfiguration,
) -> state.State:
    """Return the state of a vehicle that has not been placed yet, with all its constants.

    Args:
        configuration: configuration of the vehicle.
        friction: friction of the ground.
        physics_step: length of a step [s].
        elevation: elevation of the ground.
    """
    n = len(configuration.wheels)
    plant, losses = _losses(configuration, _plant(configuration, friction, physics_step))
    return state.State(
        plant=plant,
        terrain=elevation.terrain,
        losses=losses,
        suspension=_suspension(configuration),
        body=np.zeros(1, state.BODY),
        contacts=plant.contact.copy(),
        rollers=_rollers(configuration),
        treads=_treads(configuration, plant),
        wheels=np.zeros(n, state.WHEEL),
        counters=np.zeros(1, state.COUNTERS),
        pressure=build_brake_pressure(configuration.brake, n, physics_step),
        loads=np.empty(n),
    )


def _plant(
    configuration: VehicleConfiguration, friction: FrictionMap, physics_step: float
) -> state.Plant:
    """Return the constants of a vehicle for the kernel."""
    kinematics, masses = PlatformKinematics.of(configuration.wheels), configuration.masses
    geometry = kinematics.geometry
    tire, brake = configuration.tire, configuration.brake
    # Ratio of the deceleration that a velocity drive commands to the brake torque [m/s^2 per N m].
    ramp = brake.ramp / (brake.max_torque or math.inf) if brake.is_ramped else 0.0
    lever = geometry.position - masses.center
    moment = cross(lever, geometry.active)
    rim = np.sum(geometry.active * geometry.rolling, axis=1)
    rollers = configuration.roller_geometries if configuration.contacts_move else ()
    plant = state.Plant(
        dt=float(physics_step),
        mass=masses.mass,
        yaw_inertia=masses.yaw_inertia,
        center=(float(masses.center[0]), float(masses.center[1])),
        filter_share=physics_step / (physics_step + configuration.load_transfer_time),
        contact=_structured(state.CONTACT, lever, geometry.active, moment, rim),
        radius=geometry.radius,
        mobility=_mobility(configuration, geometry, lever, moment, rollers),
        rolling=np.zeros((len(lever), 3)),
        position=lever,
        plane=load_plane(lever),
        hull=support_polygon(lever),
        wheel_inertia=configuration.wheel_inertia,
        motor=configuration.drive.motor(physics_step),
        drive_power=configuration.drive.max_power or math.inf,
        drive_stiffness=configuration.drive.stiffness,
        ramp=ramp / geometry.radius,
        tire=kernel_parameters(tire),
        largest_load=tire.largest_load,
        stiffness=tire.stiffness,
        damping=tire.damping,
        vertical_stiffness=tire.vertical_stiffness,
        slip_speed=tire.slip_speed,
        friction=float(friction.base),
        patches=friction.table,
        grip=configuration.by_wheel("friction"),
        brake_share=configuration.by_wheel("brake"),
        brake_power=brake.max_power or math.inf,
        rollers=np.array([roller.constants for roller in rollers], AXIS).reshape(-1, 2),
        roller_pitch=2.0 * rollers[0].half_pitch if rollers else 0.0,
    )
    radius = geometry.radius - static_loads(plant) / tire.vertical_stiffness
    return plant._replace(rolling=kinematics.wheel_speeds(np.eye(3), radius).T.copy())


def _losses(
    configuration: VehicleConfiguration, plant: state.Plant
) -> tuple[state.Plant, state.Losses]:
    """Return a plant whose mobilities include the passive losses, and the constants of the losses.

    Without losses, and for wheels with individual rollers, the plant is returned unchanged.
    """
    losses = configuration.passive_losses
    if not losses.active or configuration.wheel_model == "rollers":
        return plant, state.Losses(np.zeros(0, state.LOSS), 0.0, 0.0, 0.0, 0.0)
    geometry, masses = PlatformKinematics.of(configuration.wheels).geometry, configuration.masses
    lever = geometry.position - masses.center
    moment = cross(lever, geometry.passive)
    rim = np.sum(geometry.passive * geometry.rolling, axis=1)
    mobilities = []
    for one, other in ((geometry.passive, geometry.active), (geometry.passive, geometry.passive)):
        product = one @ other.T / masses.mass
        product += np.outer(moment, cross(lever, other)) / masses.yaw_inertia
        mobilities.append(np.abs(product))
    # A wheel's spin couples its tire and its roller.
    own = geometry.radius**2 * np.abs(rim) / configuration.wheel_inertia
    active_rim = np.abs(plant.contact["rim"])
    coupled = plant.mobility + (mobilities[0].sum(axis=0) + own * active_rim)
    mobility = mobilities[0].sum(axis=1) + mobilities[1].sum(axis=1)
    mobility += own * (active_rim + np.abs(rim))
    constants = _structured(state.LOSS, geometry.passive, moment, rim, mobility)
    shares = losses.constant_share, losses.growing_share, losses.inertia, losses.speed_growth
    return plant._replace(mobility=coupled), state.Losses(constants, *shares)


def _rollers(configuration: VehicleConfiguration) -> state.Rollers | None:
    """Return the individual rollers of a vehicle; None for single-roller wheels."""
    if configuration.wheel_model != "rollers":
        return None
    rollers, n = configuration.rollers, len(configuration.wheels)
    return state.Rollers(
        tire_y=passive_parameters(configuration.tire),
        inertia=rollers.inertias,
        stiffness=rollers.stiffness,
        damping=rollers.damping,
        overlap=rollers.overlap,
        constant=configuration.passive_losses.constant_share,
        growing=configuration.passive_losses.growing_share,
        quadratic=configuration.passive_losses.speed_growth,
        state=np.zeros((n, rollers.count), state.ROLLER),
        push=np.zeros((n, 5)),
    )


def _treads(configuration: VehicleConfiguration, plant: state.Plant) -> state.Treads | None:
    """Return the contacts of a vehicle with conventional wheels; None for other vehicles."""
    geometry = PlatformKinematics.of(configuration.wheels).geometry
    conventional = geometry.conventional
    if not conventional.any():
        return None
    n, radius = len(conventional), geometry.radius - static_loads(plant) / plant.vertical_stiffness
    steering, lateral = build_steering(configuration.wheels, geometry, radius)
    return state.Treads(
        conventional=conventional,
        tire_y=passive_parameters(configuration.tire),
        state=np.zeros(n, state.ROLLER),
        push=np.zeros((n, 3)),
        steering=steering,
        lateral=lateral,
    )


def _suspension(configuration: VehicleConfiguration) -> state.Suspension:
    """Return the suspension of a chassis for the kernel."""
    masses = configuration.masses
    springs, n = configuration.suspension, len(configuration.wheels)
    box = masses.mass / 12.0 * (4.0 * masses.height**2 + np.square(configuration.chassis_size))
    return state.Suspension(
        stiffness=springs.stiffness,
        damping=2.0 * springs.damping_ratio * math.sqrt(springs.stiffness * masses.mass / n),
        pitch_inertia=springs.pitch_inertia or float(box[0]),
        roll_inertia=springs.roll_inertia or float(box[1]),
        mounted=configuration.by_wheel("mounted"),
        half_gap=0.5 * configuration.rollers.gap,
        ground=np.zeros(n),
        sunk=np.zeros(n),
        chassis=np.zeros(1, state.CHASSIS),
    )


def static_loads(plant: state.Plant) -> FloatArray:
    """Return the wheel loads at rest [N], shape (N,)."""
    loads = np.empty(len(plant.position))
    weight = plant.mass * GRAVITY
    wheel_loads(plant.position, plant.plane, plant.hull, weight, 0.0, 0.0, loads)
    return loads


def _structured(kind: np.dtype[np.void], *columns: FloatArray) -> state.Structured:
    """Return a structured array of the type `kind`, shape (N,).

    Its fields are filled, in their order, from columns of shape (N,) or (N, k).
    """
    rows = np.concatenate([column.reshape(len(column), -1) for column in columns], axis=1)
    return rows.view(kind)[:, 0]


def _mobility(
    configuration: VehicleConfiguration,
    geometry: PlatformGeometry,
    lever: FloatArray,
    moment: FloatArray,
    rollers: Sequence[RollerGeometry],
) -> FloatArray:
    """Return the sum of absolute values in each row of the mobility matrix [1/kg], shape (N,).

    Element (i, j) of this matrix is the acceleration of wheel i along its active direction per
    force of wheel j. If the contacts move or exert forces in all directions, the result is an upper
    bound of the sum.

    Args:
        configuration: configuration of the vehicle.
        geometry: geometry of the wheels.
        lever: wheel centers from the center of gravity [m], shape (N, 2).
        moment: moments of unit forces along the active directions [m], shape (N,).
        rollers: rollers of each wheel, along which its contact moves; empty if it does not move.
    """
    masses, active = configuration.masses, geometry.active
    if rollers or geometry.conventional.any():
        jump = np.array([roller.jump for roller in rollers]) if rollers else 0.0
        # This upper bound is valid for all wheel angles; two rollers may carry a wheel.
        reach = np.linalg.norm(lever, axis=1) + jump
        total = len(lever) / masses.mass + reach * reach.sum() / masses.yaw_inertia
        return np.asarray(total * (2.0 if configuration.wheel_model == "rollers" else 1.0))
    mobility = active @ active.T / masses.mass + np.outer(moment, moment) / masses.yaw_inertia
    return np.asarray(np.sum(np.abs(mobility), axis=1))
