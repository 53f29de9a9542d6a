"""Turns a vehicle's configuration into the constants of the dynamics kernel."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from omni_platform.geometry import WheelMount, cross
from omni_platform.kinematics import PlatformKinematics
from omni_sim.ground.friction import FrictionMap
from omni_sim.vehicle import dynamics
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.loads import GRAVITY, MassProperties, load_plane, support_polygon, wheel_loads

FloatArray = NDArray[np.float64]


def build_plant(
    configuration: VehicleConfiguration,
    kinematics: PlatformKinematics,
    masses: MassProperties,
    friction: FrictionMap,
    physics_step: float,
) -> dynamics.Plant:
    """Lay out the constants of a vehicle for the kernel.

    Args:
        configuration: what the vehicle is made of.
        kinematics: of its wheels.
        masses: body and load together.
        friction: of the ground.
        physics_step: [s].
    """
    geometry = kinematics.geometry
    tire = configuration.tire
    lever = geometry.position - masses.centre
    moment = cross(lever, geometry.active)
    mobility = geometry.active @ geometry.active.T / masses.mass
    mobility += np.outer(moment, moment) / masses.yaw_inertia
    mobility_sum = np.sum(np.abs(mobility), axis=1)
    rollers, pitch = np.zeros((len(lever), 5)), 0.0
    if configuration.contacts_move:
        geometries = configuration.roller_geometries
        rollers = np.array([geometry.table_row for geometry in geometries])
        pitch = 2.0 * geometries[0].half_pitch
        jump = np.array([geometry.jump for geometry in geometries])
        # An upper bound over all wheel angles; two rollers may share a wheel.
        reach = np.linalg.norm(lever, axis=1) + jump
        mobility_sum = len(lever) / masses.mass + reach * reach.sum() / masses.yaw_inertia
        mobility_sum *= 2.0 if configuration.wheel_model == "rollers" else 1.0
    plant = dynamics.Plant(
        dt=float(physics_step),
        mass=masses.mass,
        yaw_inertia=masses.yaw_inertia,
        centre_x=float(masses.centre[0]),
        centre_y=float(masses.centre[1]),
        height=masses.height,
        filter_share=physics_step / (physics_step + configuration.load_transfer_time),
        wheel=np.column_stack(
            (
                lever,
                geometry.active,
                moment,
                np.sum(geometry.active * geometry.rolling, axis=1),
                geometry.radius,
                mobility_sum,
            )
        ),
        rolling=np.zeros((len(lever), 3)),
        plane=load_plane(lever),
        hull=support_polygon(lever),
        wheel_inertia=configuration.wheel_inertia,
        drive_limit=configuration.drive.max_torque,
        tire=tire.kernel_parameters,
        largest_load=tire.largest_load,
        stiffness=tire.stiffness,
        damping=tire.damping,
        vertical_stiffness=tire.vertical_stiffness,
        slip_speed=tire.slip_speed,
        friction=float(friction.base),
        patches=friction.table,
        rollers=rollers,
        roller_pitch=pitch,
    )
    radius = geometry.radius - static_loads(plant) / tire.vertical_stiffness
    mounts: Mapping[str, WheelMount] = {
        name: dataclasses.replace(mount, radius=float(rolling_radius))
        for (name, mount), rolling_radius in zip(configuration.wheels.items(), radius, strict=True)
    }
    return plant._replace(rolling=PlatformKinematics(mounts).wheel_speeds(np.eye(3)).T.copy())


def build_losses(
    configuration: VehicleConfiguration,
    kinematics: PlatformKinematics,
    masses: MassProperties,
    plant: dynamics.Plant,
) -> tuple[dynamics.Plant, dynamics.Losses]:
    """Lay out the passive losses, and the plant as their forces couple to its own.

    Args:
        configuration: what the vehicle is made of.
        kinematics: of its wheels.
        masses: body and load together.
        plant: from `build_plant`; returned as it is if there are no losses.
    """
    losses = configuration.passive_losses
    if not losses.active:
        return plant, dynamics.Losses(np.zeros((0, 5)), 0.0, 0.0, 0.0)
    geometry = kinematics.geometry
    lever = geometry.position - masses.centre
    moment = cross(lever, geometry.passive)
    rim = np.sum(geometry.passive * geometry.rolling, axis=1)
    mobilities = []
    for one, other in ((geometry.passive, geometry.active), (geometry.passive, geometry.passive)):
        product = one @ other.T / masses.mass
        product += np.outer(moment, cross(lever, other)) / masses.yaw_inertia
        mobilities.append(np.abs(product))
    # A wheel's spin couples its tire and its roller.
    own = geometry.radius**2 * np.abs(rim) / configuration.wheel_inertia
    active_rim = np.abs(plant.wheel[:, dynamics.RIM])
    wheel = plant.wheel.copy()
    wheel[:, dynamics.MOBILITY] += mobilities[0].sum(axis=0) + own * active_rim
    mobility = mobilities[0].sum(axis=1) + mobilities[1].sum(axis=1)
    mobility += own * (active_rim + np.abs(rim))
    constants = np.column_stack((geometry.passive, moment, rim, mobility))
    return plant._replace(wheel=wheel), dynamics.Losses(
        constants, losses.constant_share, losses.growing_share, losses.inertia
    )


def static_loads(plant: dynamics.Plant) -> FloatArray:
    """Return the wheel loads at rest [N], shape (N,)."""
    loads = np.empty(len(plant.wheel))
    weight = plant.mass * GRAVITY
    wheel_loads(plant.wheel, plant.plane, plant.hull, weight, 0.0, 0.0, loads)
    return loads
