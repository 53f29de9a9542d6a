"""The configuration files of an identified candidate: its vehicle and its experiment."""

from __future__ import annotations

from pathlib import Path

from omni_analysis.loop.experiment import ExperimentConfiguration

VEHICLE = "table_2_mecanum"
"""Name of the identified vehicle."""

_VEHICLE = """\
# The Mecanum platform that gives Table 2, found by ./omni study table2 --identify; see
# docs/identification.md. Wheels, tire and the inertia of the wheels are assumed.
wheels: # order of Eq. (35); rollers form an X seen from above
{wheels}
chassis_length: {chassis_length:g}
chassis_width: {chassis_width:g}
body: {{mass: {body_mass:g}, height: {height:g}, yaw_inertia: {body_inertia:g}}}
load: {{mass: {load_mass:g}, x: {load_x:g}, y: {load_y:g}, height: {height:g}}} # a point
tire: rill_table_1
brake: {{max_torque: {torque:g}}}
drive: {{max_torque: {drive:.1f}, stiffness: {stiffness:.1f}}} # only before the pedal is down
wheel_inertia: {wheel_inertia:g}
"""

_EXPERIMENT = """\
# Braking out of a turn while translating, on a slippery patch (Figures 43 to 48, Table 2).
# Motion, ground and vehicle were found by ./omni study table2 --identify; see
# docs/identification.md. At the start of braking base_link is at the origin and moves along y.
description: Braking out of a turn-while-translate maneuver
vehicle: {vehicle}
ground:
  texture: {{kind: cork}}
  friction: {friction:g}
  patches:
    ice: {{x: {x:g}, y: {y:g}, length: {length:g}, width: {width:g}, heading_deg: {heading:g}, \
friction: {patch_friction:g}}}
sensors: three_generic
feedback: velocity_sensor
brake_assist: {{second_opinion: false}} # as the text's assistant, which knows the twist alone
maneuver:
  y: {start_y:.10g}
  heading_deg: {start_heading:.10g}
  speed: {speed:g}
  direction_deg: {direction:.10g}
  yaw_rate_deg: {yaw_rate:.10g}
  hold_world_direction: true
  brake_time: {brake_time:g}
simulation: {{duration_limit: {duration_limit:g}}}
variants:
  unassisted:
    brake_assist: {{enabled: false}}
  zero:
    brake_assist: {{weighting: zero}}
  cosine:
    brake_assist: {{weighting: cosine}}
  k1:
    brake_assist: {{weighting: enhanced, k: 1}}
  k7:
    brake_assist: {{weighting: enhanced, k: 7}}
"""


def write_files(configuration: ExperimentConfiguration, folder: Path) -> tuple[Path, Path]:
    """Write vehicle and experiment of a candidate, as they go to ``config/``.

    Args:
        configuration: any variant of the candidate.
        folder: where the two files go.

    Returns:
        Vehicle file and experiment file.
    """
    vehicle, maneuver = configuration.vehicle, configuration.maneuver
    ground = configuration.ground
    (patch,) = ground.patches.values()
    wheels = "\n".join(
        f"  {name}: {{x: {mount.x:g}, y: {mount.y:g}, "
        f"roller_angle_deg: {mount.roller_angle_deg:.1f}, radius: {mount.radius:g}}}"
        for name, mount in vehicle.wheels.items()
    )
    vehicle_file = folder / f"{VEHICLE}.yaml"
    vehicle_file.write_text(
        _VEHICLE.format(
            wheels=wheels,
            chassis_length=vehicle.chassis_length,
            chassis_width=vehicle.chassis_width,
            body_mass=vehicle.body.mass,
            body_inertia=vehicle.body.yaw_inertia,
            height=vehicle.body.height,
            load_mass=vehicle.load.mass,
            load_x=vehicle.load.x,
            load_y=vehicle.load.y,
            torque=vehicle.brake.max_torque,
            drive=vehicle.drive.max_torque,
            stiffness=vehicle.drive.stiffness,
            wheel_inertia=vehicle.wheel_inertia,
        ),
        encoding="utf-8",
    )
    experiment_file = folder / "turn_while_translate.yaml"
    experiment_file.write_text(
        _EXPERIMENT.format(
            vehicle=VEHICLE,
            friction=ground.friction,
            x=patch.x,
            y=patch.y,
            length=patch.length,
            width=patch.width,
            heading=patch.heading_deg,
            patch_friction=patch.friction,
            start_y=maneuver.y,
            start_heading=maneuver.heading_deg,
            speed=maneuver.speed,
            direction=maneuver.direction_deg,
            yaw_rate=maneuver.yaw_rate_deg,
            brake_time=maneuver.brake_time,
            duration_limit=configuration.simulation.duration_limit,
        ),
        encoding="utf-8",
    )
    return vehicle_file, experiment_file
