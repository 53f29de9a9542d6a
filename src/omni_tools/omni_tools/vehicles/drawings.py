"""Descriptions and drawings of vehicles, tires, grounds and line cameras."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from omni_core.geometry import PlatformGeometry
from omni_core.quantities import plain
from omni_core.sensors import LineSensor
from omni_runs.figures import style
from omni_runs.figures.scene import Scene, ahead_up, placed, rectangle
from omni_runs.figures.units import readable_unit
from omni_runs.plausibility import camera_speed
from omni_sim.configuration import GroundConfiguration
from omni_sim.texture.cache import TextureCache
from omni_sim.tire.interface.configuration import TireConfiguration
from omni_sim.tire.tire import Tire
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.plausibility import brakes_over_grip, wheel_facts
from omni_sim.vehicle.rollers import Rollers

_FROM_ABOVE: dict[str, Any] = {"x": "right of base_link [m]", "y": "ahead of base_link [m]"}


def vehicle_in_words(vehicle: VehicleConfiguration) -> dict[str, str]:
    """Return texts that describe a vehicle's size, masses, wheels and brakes, keyed by label."""
    masses = vehicle.masses
    facts = wheel_facts(vehicle)
    loads = [fact.load for fact in facts.values()]
    radii = sorted({mount.radius for mount in vehicle.wheels.values()})
    return {
        "chassis": f"{vehicle.chassis_length:g} x {vehicle.chassis_width:g} m",
        "mass": f"{masses.mass:g} kg, {vehicle.load.mass:g} kg of which are load, "
        f"{plain(masses.yaw_inertia)} kg m^2 about the vertical axis",
        "center of gravity": f"({', '.join(map(plain, masses.center))}) m",
        "wheels": f"{len(vehicle.wheels)} of radius {', '.join(f'{r:g}' for r in radii)} m: "
        f"{', '.join(vehicle.wheels)}",
        **_rollers_or_steering(vehicle),
        "wheel loads": f"{plain(min(loads))} to {plain(max(loads))} N; the tire is valid up to "
        f"{plain(vehicle.tire.largest_load)} N",
        "brakes": f"{vehicle.brake.max_torque:g} N m, {brakes_over_grip(facts):.2g} times the "
        "friction limit on dry ground",
        "tire": vehicle.tire.model,
    }


def _rollers_or_steering(vehicle: VehicleConfiguration) -> dict[str, str]:
    """Return a text about the rollers, or about wheels without rollers and their steering."""
    conventional = [name for name, one in vehicle.wheels.items() if one.kind == "conventional"]
    if conventional:
        steered = ", ".join(
            f"{name} to {one.steering_limit_deg:g} deg at up to {one.steering_rate_deg:g} deg/s"
            for name, one in vehicle.wheels.items()
            if one.is_steered
        )
        return {"without rollers": ", ".join(conventional), "steered": steered or "no wheel"}
    rollers = Rollers.of(vehicle.wheels)
    shape = f"{rollers.shape} seen from above, " if rollers.shape else ""
    return {
        "rollers": f"{shape}lever in yaw {rollers.yaw_lever:.2g} m, smallest singular value of the "
        f"kinematics {rollers.smallest_singular_value:.2g}"
    }


def draw_vehicle(
    vehicle: VehicleConfiguration, sensors: Mapping[str, LineSensor] | None = None
) -> Figure:
    """Draw a vehicle from above: chassis, wheels with their active directions, masses, cameras.

    Args:
        vehicle: vehicle to draw.
        sensors: line cameras under the vehicle.
    """
    scene = Scene.of_vehicle(vehicle)
    figure, ((axes,),) = style.panels(
        "top view, forward is up; load of each wheel", size=(7.0, 7.0), **_FROM_ABOVE
    )
    axes.add_patch(Polygon(ahead_up(scene.chassis), facecolor=style.PALE, edgecolor=style.GRAY))
    geometry = PlatformGeometry.from_wheels(vehicle.wheels)
    for row, outline in enumerate(scene.wheel_outlines):
        axes.add_patch(Polygon(ahead_up(outline), facecolor="white", edgecolor="black"))
        place, reach = geometry.position[row], 1.6 * float(geometry.radius[row])
        ends = place + reach * np.outer((-1.0, 1.0), geometry.active[row])
        label = "pushes along" if not row else None
        axes.plot(*ahead_up(ends).T, color=style.BLUE, linewidth=2.0, label=label)
    for (name, fact), (x, y), radius in zip(
        wheel_facts(vehicle).items(), ahead_up(geometry.position), geometry.radius, strict=True
    ):
        # Next to the wheel, on its outer side.
        side = 1.0 if x >= 0.0 else -1.0
        axes.annotate(
            f"{name.replace('_', ' ')}\n{plain(fact.load)} N",
            (x + 1.8 * side * radius, y),
            ha="left" if side > 0.0 else "right",
            va="center",
        )
    masses = vehicle.masses
    axes.plot(
        *ahead_up(masses.center[None])[0], "o", color=style.VERMILLION, label="center of gravity"
    )
    for index, (name, sensor) in enumerate((sensors or {}).items()):
        pose = (sensor.x, sensor.y, math.radians(sensor.heading_deg))
        view = placed(rectangle(sensor.length, sensor.width), pose)
        axes.add_patch(Polygon(ahead_up(view), facecolor=style.ORANGE, edgecolor=style.ORANGE))
        style.note(axes, name, ahead_up(view[:1])[0], (4, 4))
        if not index:
            axes.plot([], [], "s", color=style.ORANGE, label="line camera")
    axes.set_aspect("equal")
    axes.margins(0.35, 0.1)
    axes.autoscale_view()
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def tire_in_words(tire: TireConfiguration) -> dict[str, str]:
    """Return texts that describe a tire's model, load and peak, keyed by label."""
    half = 0.5 * tire.largest_load
    curve = Tire(tire).curve(half)
    return {
        "model": tire.model,
        "largest load": f"{tire.largest_load:g} N",
        f"at {half:g} N": f"largest force {plain(curve.peak_force)} N at a slip of "
        f"{plain(curve.peak_slip)}, sliding {plain(curve.slide_force)} N",
        "stiffness": f"{plain(tire.stiffness)} N/m horizontally, "
        f"{plain(tire.vertical_stiffness)} N/m vertically",
    }


def draw_tire(tire: TireConfiguration, name: str) -> Figure:
    """Draw force versus slip at four loads."""
    slip = np.linspace(0.0, 1.0, 401)
    unit, factor = readable_unit("N", Tire(tire).force(slip, tire.largest_load))
    figure, ((axes,),) = style.panels(
        f"{name}: steady force versus slip", size=(8.0, 5.0), x="slip [1]", y=f"force [{unit}]"
    )
    for share, color in zip(
        (0.25, 0.5, 0.75, 1.0), (style.PALE, style.GRAY, style.ORANGE, style.BLUE), strict=True
    ):
        load = share * tire.largest_load
        force = factor * Tire(tire).force(slip, load)
        axes.plot(slip, force, color=color, label=f"{factor * load:g} {unit}")
    axes.legend(title="wheel load")
    return figure


def ground_in_words(ground: GroundConfiguration) -> dict[str, str]:
    """Return texts that describe a ground's material, friction and patches, keyed by label."""
    patches = [f"{name} (friction {patch.friction:g})" for name, patch in ground.patches.items()]
    return {
        "looks like": ground.texture.kind,
        "friction": f"{ground.friction:g} of the tire's",
        "patches": ", ".join(patches) or "none",
    }


def draw_ground(ground: GroundConfiguration, name: str, edge: float = 0.2) -> Figure:
    """Draw a square section, `edge` [m] long, of a ground in gray levels."""
    texture = TextureCache.of_user().texture(ground.texture)
    figure, ((axes,),) = style.panels("", size=(6.0, 6.4))
    piece = style.draw_texture(axes, texture.gray, texture.texel, edge)
    words = f"gray levels {piece.min()} to {piece.max()}, mean {piece.mean():.0f}"
    style.add_title(figure, f"{name}: {words}")
    return figure


def sensors_in_words(sensors: Mapping[str, LineSensor]) -> dict[str, str]:
    """Return a text on position, field of view and speed limits of each camera, keyed by name."""
    return {
        name: f"at ({one.x:g}, {one.y:g}) m, {one.heading_deg:g} deg, {one.pixels} px on "
        f"{1e3 * one.length:g} x {1e3 * one.width:g} mm at {one.line_rate:g} lines/s; 60 % overlap "
        f"up to {plain(camera_speed(one, 0.0))} m/s forward, "
        f"{plain(camera_speed(one, math.pi / 2))} m/s sideways"
        for name, one in sensors.items()
    }


def draw_sensors(sensors: Mapping[str, LineSensor]) -> Figure:
    """Draw the cameras from above, with their fields of view enlarged ten times."""
    title = "line cameras, top view, forward is up (fields of view enlarged ten times)"
    figure, ((axes,),) = style.panels(title, size=(6.5, 6.5), **_FROM_ABOVE)
    for name, one in sensors.items():
        heading = math.radians(one.heading_deg)
        view = placed(rectangle(10 * one.length, 10 * one.width), (one.x, one.y, heading))
        axes.add_patch(Polygon(ahead_up(view), facecolor=style.PALE, edgecolor=style.ORANGE))
        axes.annotate(name, (-one.y, one.x), ha="center", va="center")
    axes.plot(0.0, 0.0, "+", color=style.GRAY)
    axes.set_aspect("equal")
    axes.margins(0.15)
    axes.autoscale_view()
    return figure
