"""Cause of the rotation: the forces of locked wheels, and the sliding manifold.

A vehicle slides straight ahead on locked wheels with its load in the middle and at its configured
position; the forces are those of the simulation. The manifold of section 3.4 is drawn too: the
weight of a wheel (Figure 28), and the wheels that may brake over sideways velocity and yaw rate.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np

from omni_brake_assist import sliding_manifold, weighting
from omni_loop.metrics import Metric
from omni_platform.configuration import Configuration, parameter
from omni_platform.geometry import PlatformGeometry
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.loads import MassProperties
from omni_sim.vehicle.vehicle import Vehicle
from omni_studies.braking.swerve_figures import LockedWheels, draw_forces, draw_manifold
from omni_studies.identification.figures import weighting_functions
from omni_studies.study import StudyResult, StudyRun

_SETTLED = 0.15  # [s] after the pedal: locked, and the load has moved forward


@dataclass(frozen=True, kw_only=True)
class Options(Configuration):
    """Vehicle and speed."""

    vehicle: str = parameter("mecanum_forklift")
    """a file of config/vehicles/"""
    speed: float = parameter(5.0, unit="m/s", minimum=1.0, maximum=50.0)
    """straight ahead"""
    k: int = parameter(3, minimum=1, maximum=99)
    """of the enhanced weighting"""


def run(options: Options, study: StudyRun) -> StudyResult:
    """Lock the wheels, draw the forces and the manifold."""
    loaded = study.experiments.vehicle(options.vehicle)
    cases = {"even": _with_load_in_the_middle(loaded), "uneven": loaded}
    wheels = {case: locked(vehicle, options.speed) for case, vehicle in cases.items()}
    metrics: dict[str, Metric] = {}
    for case, one in wheels.items():
        metrics |= {
            f"braking_force.{case}": Metric(-float(one.total[0]), "N"),
            f"side_force.{case}": Metric(float(one.total[1]), "N"),
            f"yaw_moment.{case}": Metric(one.moment, "N m"),
        }
    geometry = PlatformGeometry.from_wheels(loaded.wheels)
    manifolds = {
        words: sliding_manifold.SlidingManifold(geometry, weighting.weighting_function(kind, k))
        for words, kind, k in (
            ("\u03c8 = 0: heading and line alone", "zero", 1),
            (f"enhanced, k = {options.k}", "enhanced", options.k),
            ("enhanced, k = 1: distance counts more", "enhanced", 1),
        )
    }
    study.figure("forces.png", draw_forces(wheels))
    study.figure("weighting.png", weighting_functions())
    study.figure("manifold.png", draw_manifold(manifolds, options.speed))
    return study.result(metrics)


def _with_load_in_the_middle(vehicle: VehicleConfiguration) -> VehicleConfiguration:
    body = dataclasses.replace(vehicle.body, x=0.0, y=0.0)
    return dataclasses.replace(
        vehicle, body=body, load=dataclasses.replace(vehicle.load, x=0.0, y=0.0)
    )


def locked(configuration: VehicleConfiguration, speed: float) -> LockedWheels:
    """Return the forces of a vehicle that has begun to slide straight ahead.

    Args:
        configuration: the vehicle, on dry level ground.
        speed: before the brakes act on all wheels [m/s].
    """
    vehicle = Vehicle(configuration, twist=np.array([speed, 0.0, 0.0]))
    everywhere = np.ones(len(configuration.wheels))
    vehicle.advance(round(_SETTLED / vehicle.physics_step), 1.0, everywhere, np.zeros(3))
    wheels = vehicle.wheels
    masses = MassProperties.of(configuration.body, configuration.load)
    return LockedWheels(configuration, wheels["force"].copy(), wheels["load"].copy(), masses.center)
