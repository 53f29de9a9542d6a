"""Simulates stops with compiled kernels, where pip has installed the cores and nothing else."""

import math

import numba
import numpy as np

from omni_brake_assist.configuration import BrakeAssistConfiguration
from omni_brake_assist.laws.law import Motion
from omni_brake_assist.laws.sliding_mode import SlidingMode
from omni_core.geometry import PlatformGeometry, WheelMount
from omni_sim.configuration import SimulationConfiguration, SimulatorConfiguration
from omni_sim.driver.scripted import ManeuverConfiguration
from omni_sim.simulator import Simulator
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.loads import MassConfiguration

SPEED = 3.0  # m/s
DURATION = 2.0  # s; longer than a stop


def stop(*, assisted: bool) -> float:
    """Stop a vehicle with an off-center load from SPEED; return its rotation [rad]."""
    wheels = {
        f"{end}_{side}": WheelMount(x=0.6 * x, y=0.5 * y, roller_angle_deg=-45.0 * x * y)
        for end, x in (("front", 1), ("rear", -1))
        for side, y in (("left", 1), ("right", -1))
    }
    vehicle = VehicleConfiguration(
        wheels=wheels,
        body=MassConfiguration(mass=400.0, height=0.2, yaw_inertia=100.0),
        load=MassConfiguration(mass=200.0, height=0.3, x=0.2, y=0.3),
    )
    configuration = SimulatorConfiguration(
        vehicle=vehicle,
        sensors={},
        maneuver=ManeuverConfiguration(speed=SPEED, brake_time=0.0),
        simulation=SimulationConfiguration(render_lines=False),
    )
    simulator = Simulator(configuration)
    assist = BrakeAssistConfiguration(wheels=wheels)
    law = SlidingMode(assist, PlatformGeometry.from_wheels(wheels))
    error, enable = np.zeros(len(wheels)), np.ones(len(wheels))
    period = configuration.simulation.control_period
    for step in range(round(DURATION / period)):
        seen = simulator.observe()
        v_x, v_y, yaw_rate = seen.twist
        if assisted and v_x > assist.speed_threshold:
            across = -math.sin(seen.pose[2]), math.cos(seen.pose[2])
            motion = Motion(
                step == 0, period, v_x, v_y, yaw_rate, *across, seen.pedal, seen.wheel_speed
            )
            law.step(motion, error, enable)
        else:
            enable[:] = 1.0
        simulator.advance(enable)
    seen = simulator.observe()
    assert np.all(np.abs(seen.twist) < 1e-3), f"not at rest: {seen.twist}"
    return abs(float(seen.pose[2]))


if __name__ == "__main__":
    assert not numba.config.DISABLE_JIT
    alone, assisted = stop(assisted=False), stop(assisted=True)
    assert assisted < 0.5 * alone, f"rotation: {assisted} rad, without the law {alone} rad"
    print(
        f"rotation in a stop: {math.degrees(alone):.1f} deg, with the law "
        f"{math.degrees(assisted):.1f} deg"
    )
