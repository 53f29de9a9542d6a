"""Creation of a vehicle's files from a few measurements; every estimated value is marked."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from omni_core.brakes import BRAKES, BRAKES_IN_WORDS, ON_OFF, BrakeConfiguration
from omni_core.commands.command_report import write_text
from omni_core.configuration import (
    Configuration,
    ConfigurationError,
    declared_parameters,
    parameter,
    to_mapping,
)
from omni_core.geometry import TYPICAL_WIDTH
from omni_core.quantities import GRAVITY
from omni_runs.yaml_files import commented_yaml, merge
from omni_sim.tire.interface.configuration import TireConfiguration
from omni_sim.wheel.roller_geometry import RollerConfiguration

_MECANUM, _OMNI = "mecanum", "omni"


class Measured(Configuration):
    """Measured size, mass and equipment of a vehicle."""

    length: float = parameter(unit="m", above=0.0, maximum=50.0)
    """length of the chassis"""
    width: float = parameter(unit="m", above=0.0, maximum=50.0)
    """width of the chassis"""
    mass: float = parameter(unit="kg", minimum=0.5, maximum=1.0e5)
    """mass of the vehicle with its wheels"""
    wheel_radius: float = parameter(unit="m", above=0.0, maximum=2.0)
    """radius of a wheel"""
    kind: str = parameter(_MECANUM, choices=(_MECANUM, _OMNI))
    """type of the wheels: `mecanum` in pairs along the sides, or `omni` for omni-wheels on a
    circle"""
    wheels: int = parameter(4, minimum=3, maximum=12)
    """number of wheels; must be even for the type `mecanum`"""
    load: float = parameter(0.0, unit="kg", minimum=0.0, maximum=1.0e5)
    """mass of a load at the front left"""
    drive_torque: float = parameter(0.0, unit="N m", minimum=0.0, maximum=1.0e5)
    """maximum torque of a drive at its wheel; 0 for the torque of the brake"""
    drive_power: float = parameter(0.0, unit="W", minimum=0.0, maximum=1.0e7)
    """maximum power with which a drive brakes its wheel; 0 for no limit"""
    brakes: str = parameter(ON_OFF, choices=tuple(BRAKES), description=BRAKES_IN_WORDS)

    def check_consistency(self) -> None:
        """Check that the wheels fit on the chassis and that their number is valid."""
        if self.kind == _MECANUM and (self.wheels < 4 or self.wheels % 2):
            raise ConfigurationError("wheels", f"{self.wheels} must be 4, 6, ... for mecanum")
        across = 2.0 * self.wheel_radius
        if across * max(self.wheels // 2, 1) > self.length or across > self.width:
            raise ConfigurationError(
                "wheel_radius",
                f"wheels of {across:g} m diameter do not fit under a chassis of {self.length:g} x "
                f"{self.width:g} m",
            )


class MeasuredByFiles(Measured):
    """Measured values of a vehicle whose files give the positions of the wheels."""

    def check_consistency(self) -> None:
        """Accept any wheels: their number and positions are those of the files."""


class KnownValues(NamedTuple):
    """Values that replace the estimates of a vehicle's files.

    Attributes:
        heading: text at the beginning of the vehicle's file; empty for the usual one.
        vehicle: nested values of the vehicle's file; `wheels` replaces all wheels.
        cameras: positions and headings of cameras that look at the ground, keyed by name.
        experiment: nested values of the experiment's file.
        sources: where the values come from, keyed by dotted key of the vehicle's file.
    """

    heading: str = ""
    vehicle: Mapping[str, Any] = {}
    cameras: Mapping[str, Mapping[str, float]] = {}
    experiment: Mapping[str, Any] = {}
    sources: Mapping[str, str] = {}


class Estimates(NamedTuple):
    """Ratios and typical values from which the unmeasured values of a vehicle are estimated.

    Attributes:
        density: density of a wheel with rollers of rubber and plastic on a steel hub [kg/m^3].
        height: ratio of the height of the center of gravity to the wheel radius [1].
        brake: ratio of the torque of a brake to the torque that locks the wheel [1].
        clutch: stiffness of a drive's clutch, divided by the drive torque and the wheel radius
            [s/m].
        load: wheel load for which the forces of the tire of Table 1 need no scaling [N].
        radius: wheel radius for which the stiffness of this tire needs no scaling [m].
        deceleration: deceleration from which the initial speed of the example stop is computed
            [m/s^2]; the stop is then a few vehicle lengths long.
    """

    density: float = 2500.0
    height: float = 1.5
    brake: float = 2.0
    clutch: float = 15.0
    load: float = 3000.0
    radius: float = 0.2
    deceleration: float = 5.0


_USUAL = Estimates()
_NOTHING_KNOWN = KnownValues()


def write_vehicle(
    name: str, measured: Measured, folder: Path, known: KnownValues = _NOTHING_KNOWN
) -> list[Path]:
    """Write the files of a vehicle with estimated values, its cameras, and an example stop.

    Args:
        name: name of the vehicle, used in comments.
        measured: measured values of the vehicle.
        folder: folder of the files, created if it is missing.
        known: values that replace estimates.

    Returns:
        Paths of the written files.
    """
    parts = {"vehicle": _vehicle, "sensors": _sensors, "experiment": _experiment}
    return [
        write_text(folder / f"{part}.yaml", text(name, measured, known))
        for part, text in parts.items()
    ]


def _vehicle(name: str, measured: Measured, known: KnownValues) -> str:
    mass, radius = measured.mass + measured.load, measured.wheel_radius
    placed = _omni_wheels if measured.kind == _OMNI else _mecanum_wheels
    wheels = known.vehicle.get("wheels") or placed(measured)
    carried = mass * GRAVITY / len(wheels)
    wheel_mass = math.pi * radius**2 * (TYPICAL_WIDTH * 2.0 * radius) * _USUAL.density
    locking = _USUAL.brake * carried * radius
    brake, braking = _brake(measured, locking)
    drive = measured.drive_torque or locking
    size = measured.length**2 + measured.width**2
    c_x, c_y = _middle(known)
    values: dict[str, Any] = {
        "wheels": wheels,
        "chassis_length": measured.length,
        "chassis_width": measured.width,
        "body": {
            "mass": measured.mass,
            "height": _round(_USUAL.height * radius),
            "yaw_inertia": _round(measured.mass * size / 12.0),
        },
    }
    if measured.load > 0.0:
        values["load"] = {
            "mass": measured.load,
            "x": _round(c_x + 0.3 * measured.length),
            "y": _round(c_y + 0.3 * measured.width),
            "height": _round(2.5 * radius),
        }
    values |= {
        "brake": brake,
        "drive": {"max_torque": _round(drive), "stiffness": _round(_USUAL.clutch * drive * radius)},
        "wheel_inertia": _round(0.5 * wheel_mass * radius**2),
        "rollers": _rollers(2.0 * carried, radius),
        "tire": _tire(carried, radius),
    }
    notes = {
        "wheels": "as far from the center as the chassis allows",
        "body.height": f"{_USUAL.height:g} wheel radii",
        "body.yaw_inertia": "a plate, m (l^2 + w^2) / 12",
        "load": "a point mass at the front left",
        "brake": braking,
        "drive.stiffness": f"slips by {100.0 / _USUAL.clutch:.2g} cm/s at its maximum torque",
        "wheel_inertia": f"a solid disc of {wheel_mass:.2g} kg",
        "rollers": "the default rollers, scaled to load and radius of a wheel",
        "tire": "Table 1 scaled to the load of a wheel; ./omni fit-tire fits measurements",
    }
    if not measured.drive_torque:
        notes["drive.max_torque"] = "the brake's"
    notes = {key: f"estimate: {note}" for key, note in notes.items()}
    heading = known.heading or f"{name}, {_HEADING.format(**to_mapping(measured))}"
    return commented_yaml(merge(values, known.vehicle), heading, {**notes, **known.sources})


_HEADING = (
    "{length:g} m x {width:g} m, made by ./omni new-vehicle. Size, mass\n"
    "and radius of the wheels are measured. Replace estimates by measured values, the yaw inertia\n"
    "and the brakes first."
)


def _middle(known: KnownValues) -> tuple[float, float]:
    """Return the center of the chassis in base_link [m]."""
    return known.vehicle.get("chassis_x", 0.0), known.vehicle.get("chassis_y", 0.0)


def _brake(measured: Measured, locking: float) -> tuple[dict[str, Any], str]:
    """Return the values of the brakes, and a note on their torque.

    Args:
        measured: measured values of the vehicle.
        locking: torque of a brake if it is unknown; it locks the wheel [N m].
    """
    torque, note = locking, f"{_USUAL.brake:g} times the torque that locks a wheel"
    kind = BRAKES[measured.brakes]
    if kind.is_drive and measured.drive_torque:
        torque, note = measured.drive_torque, "the torque of the drive"
    brake = {"max_torque": _round(torque), **kind.typical}
    if BrakeConfiguration(**kind.typical).is_ramped:
        brake["ramp"] = BrakeConfiguration.ramp
    if kind.is_drive and measured.drive_power:
        brake["max_power"] = measured.drive_power
    return brake, note


def _mecanum_wheels(measured: Measured) -> dict[str, dict[str, float]]:
    """Return wheels in pairs whose rollers form an X seen from above, keyed by name."""
    radius = measured.wheel_radius
    x = measured.length / 2.0 - radius
    y = measured.width / 2.0 - TYPICAL_WIDTH * radius
    pairs = measured.wheels // 2
    names = {2: ("rear", "front"), 3: ("rear", "middle", "front")}.get(
        pairs, tuple(f"row_{row + 1}" for row in range(pairs))
    )
    wheels = {}
    for row, word in enumerate(names):
        place = -x + 2.0 * x * row / (pairs - 1)
        slant = 45.0 if row < pairs / 2 else -45.0
        for side, sign in (("left", 1.0), ("right", -1.0)):
            wheels[f"{word}_{side}"] = {
                "x": _round(place),
                "y": _round(sign * y),
                "roller_angle_deg": sign * slant,
                "radius": radius,
            }
    return wheels


def _omni_wheels(measured: Measured) -> dict[str, dict[str, float]]:
    """Return wheels on a circle with radial axles and roller angle 0, keyed by name; Eq. (34)."""
    out = min(measured.length, measured.width) / 2.0 - TYPICAL_WIDTH * measured.wheel_radius
    wheels = {}
    # Symmetric about x, without a wheel on the x axis in front.
    apart = math.pi / measured.wheels
    first = math.pi / 2.0 - apart if measured.wheels % 2 else apart
    for row in range(measured.wheels):
        angle = first + 2.0 * apart * row
        wheels[f"wheel_{row + 1}"] = {
            "x": round(out * math.cos(angle), 6) + 0.0,  # no -0.0
            "y": round(out * math.sin(angle), 6) + 0.0,
            "heading_deg": round(math.degrees(angle) - 90.0, 6),
            "roller_angle_deg": 0.0,
            "radius": measured.wheel_radius,
        }
    return wheels


def _tire(carried: float, radius: float) -> dict[str, Any]:
    """Return the tire of Table 1, scaled to the load [N] and the radius [m] of a wheel."""
    scale = carried / _USUAL.load

    def scaled(key: str, value: Any) -> Any:
        if isinstance(value, dict):
            return {name: scaled(name, inner) for name, inner in value.items()}
        return value if "slip" in key else _round(scale * value)

    table_1 = TireConfiguration()
    return {
        "model": table_1.model,
        table_1.model: scaled("", to_mapping(table_1.model_parameters)),
        **tire_stiffness(2.0 * carried, radius),
    }


def _rollers(largest_load: float, radius: float) -> dict[str, float]:
    """Return the default rollers, scaled to the largest load [N] and the radius [m] of a wheel."""
    usual, scale = RollerConfiguration(), radius / _USUAL.radius
    stiffer = _stiffer(largest_load, radius)
    return _permitted(
        RollerConfiguration,
        radius=scale * usual.radius,
        inertia=scale**5 * usual.inertia,
        stiffness=stiffer * usual.stiffness,
        damping=stiffer * usual.damping,
    )


def tire_stiffness(largest_load: float, radius: float = _USUAL.radius) -> dict[str, float]:
    """Return stiffness and damping of a tire, keyed by configuration key.

    Args:
        largest_load: limit on the load of the tire [N].
        radius: radius of the wheel [m].
    """
    table_1, stiffer = TireConfiguration(), _stiffer(largest_load, radius)
    return _permitted(
        TireConfiguration,
        stiffness=stiffer * table_1.stiffness,
        damping=stiffer * table_1.damping,
        vertical_stiffness=stiffer * table_1.vertical_stiffness,
    )


def _permitted(part: type[Configuration], **values: float) -> dict[str, float]:
    """Return rounded values, raised to the lower limits of their parameters in `part`."""
    limits = {name: info.minimum for name, _, info in declared_parameters(part)}
    return {name: max(_round(value), limits[name] or 0.0) for name, value in values.items()}


def _stiffer(largest_load: float, radius: float) -> float:
    """Return the ratio of the stiffness of a tire to that of the tire of Table 1 [1].

    At the largest load [N], the ratio of deflection to wheel radius [m] is the same for all tires.
    """
    return largest_load / TireConfiguration().largest_load * _USUAL.radius / radius


def _sensors(name: str, measured: Measured, known: KnownValues) -> str:
    x, y = _round(0.35 * measured.length), _round(0.35 * measured.width)
    places = {"left": (0.0, y, 0.0), "right": (0.0, -y, 0.0), "front": (x, 0.0, 90.0)}
    found = dict(known.cameras)
    c_x, c_y = _middle(known)
    heading = (
        f"Three line cameras under {name}, as section 4.4 suggests; ./omni design-sensors finds\n"
        "better positions. Their axes are tangential, so that all cameras measure the yaw rate."
    )
    if found:
        heading = f"Line cameras under {name}, at the links of its files" + (
            "." if len(found) >= len(places) else ", and three more, as section 4.4 suggests."
        )
    if len(found) < len(places):  # fewer cannot measure the twist
        found |= {
            camera: {
                "x": _round(c_x + place[0]),
                "y": _round(c_y + place[1]),
                "heading_deg": place[2],
            }
            for camera, place in places.items()
        }
    camera = {"pixels": 1024, "length": 0.05, "width": 0.02, "line_rate": 2500.0}
    return commented_yaml({key: {**place, **camera} for key, place in found.items()}, heading)


def _experiment(name: str, measured: Measured, known: KnownValues) -> str:
    speed = min(_round(math.sqrt(2.0 * _USUAL.deceleration * 3.0 * measured.length), 2), 10.0)
    kind = BRAKES[measured.brakes]
    law = {"law": kind.law} if kind.law else {}
    values = {
        "description": f"{name} stops from {speed:g} m/s",
        "vehicle": "vehicle.yaml",
        "ground": "cork",
        "sensors": "sensors.yaml",
        "maneuver": {"speed": speed, "brake_time": 0.3},
        "brake_assist": {
            **law,
            "weighting": "enhanced",
            "k": 7,
            "nominal_mass": _round(measured.mass + measured.load),
            # A coil must not be switched again before its slower operation is complete.
            "minimum_dwell_time": kind.typical.get("release_time", 0.0),
        },
        "variants": {
            "unassisted": {"brake_assist": {"enabled": False}},
            "assisted": {"brake_assist": {"enabled": True}},
        },
    }
    heading = f"A stop of {name}; run it with ./omni run and the path of this file."
    return commented_yaml(merge(values, known.experiment), heading)


def _round(value: float, digits: int = 4) -> float:
    return float(f"{value:.{digits}g}")
