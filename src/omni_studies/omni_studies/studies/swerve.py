"""Forces that rotate a vehicle on locked wheels, and the sliding manifold without rotation.

A simulated vehicle slides straight ahead on locked wheels, first with its load in the middle and
then with its load at the configured position. The study draws the wheel forces. It also draws the
manifold of section 3.4: the weighting functions (Figure 28), and the wheels that may brake as a
function of sideways velocity and yaw rate.

Section 3.7 names wheels of different roller angles as a cause of rotation. The study simulates the
stop of the experiment straight_line with one wheel whose angle differs, in the vehicle or only in
the assistant's parameters. In the last stops, the fork has raised the load (Appendix A). Figure 24
states at which heading the rotation ends (`equilibrium`).
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from omni_brake_assist.laws.sliding_mode import SlidingManifold
from omni_brake_assist.weighting import weighting_function
from omni_core.configuration import Configuration, parameter
from omni_core.geometry import PlatformGeometry, cross
from omni_core.quantities import FloatArray, plain
from omni_runs.experiment import WITHOUT_CAMERAS, changed
from omni_runs.figures import style
from omni_runs.figures.scene import Scene, ahead_up
from omni_runs.loop import run_closed_loop
from omni_runs.metrics import Metric
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.vehicle import Vehicle
from omni_studies.identification.figures import weighting_functions
from omni_studies.study import StudyResult, StudyRun

_TITLES = {
    "even": "load in the middle: forces cancel",
    "uneven": "configured load: forces do not cancel",
}


_ANGLE_ERRORS = (0.0, 5.0, 10.0, -10.0)  # deg
_RAISED = 1.7  # height of the load on the raised fork, which the forklift carries upright [m]
_SPEED = 10.0  # speed before the stop that shows the equilibrium, as in straight_line [m/s]
_EQUILIBRIUM_TIME = 1.0  # time after which its angle is evaluated [s]


class Options(Configuration):
    """Options of the study ``swerve``: vehicle, speed and weighting."""

    vehicle: str = parameter("mecanum_forklift")
    """vehicle: a file of config/vehicles/, a path, or a vehicle's folder"""
    speed: float = parameter(5.0, unit="m/s", minimum=1.0, maximum=50.0)
    """speed straight ahead"""
    k: int = parameter(3, minimum=1, maximum=99)
    """tuning constant k of the weighting `enhanced`"""


@dataclasses.dataclass(frozen=True, eq=False)
class LockedWheels:
    """Forces of the ground on a vehicle with locked wheels.

    Attributes:
        vehicle: the sliding vehicle.
        force: force of each wheel along its active direction [N], shape (N,).
        load: load of each wheel [N], shape (N,).
        center: center of gravity in the body frame [m], shape (2,).
    """

    vehicle: VehicleConfiguration
    force: FloatArray
    load: FloatArray
    center: FloatArray

    @property
    def geometry(self) -> PlatformGeometry:
        """Positions and active directions of the wheels."""
        return PlatformGeometry.from_wheels(self.vehicle.wheels)

    @property
    def vectors(self) -> FloatArray:
        """Force of each wheel in the body frame [N], shape (N, 2)."""
        return self.force[:, None] * self.geometry.active

    @property
    def total(self) -> FloatArray:
        """Sum of the wheel forces in the body frame [N], shape (2,)."""
        return np.asarray(self.vectors.sum(axis=0), dtype=np.float64)

    @property
    def moment(self) -> float:
        """Moment of the forces about the center of gravity, counter-clockwise [N m]."""
        return float(cross(self.geometry.position - self.center, self.vectors).sum())


def run(options: Options, study: StudyRun) -> StudyResult:
    """Simulate locked wheels; draw the forces and the manifold."""
    loaded = study.experiments.vehicle(options.vehicle)
    middle = {"x": 0.0, "y": 0.0}
    cases = {"even": changed(loaded, body=middle, load=middle), "uneven": loaded}
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
        words: SlidingManifold(geometry, weighting_function(kind, k))
        for words, kind, k in (
            ("\u03c8 = 0: only heading and line of motion", "zero", 1),
            (f"enhanced, k = {options.k}", "enhanced", options.k),
            ("enhanced, k = 1: shorter stop", "enhanced", 1),
        )
    }
    metrics |= equilibrium(loaded) | roller_angle_metrics(study, options.vehicle)
    metrics |= fork_metrics(study, options.vehicle)
    study.figure("forces.png", _draw_forces(wheels))
    study.figure("weighting.png", weighting_functions())
    study.figure("manifold.png", _draw_manifold(manifolds, options.speed))
    return study.result(metrics)


def equilibrium(vehicle: VehicleConfiguration) -> dict[str, Metric]:
    """Return the angle between velocity and active direction of the most loaded wheel (Figure 24).

    Section 3.1: a vehicle with locked wheels turns until both directions are parallel.
    """
    machine = Vehicle(vehicle, twist=np.array([_SPEED, 0.0, 0.0]))
    heaviest = int(np.argmax(machine.wheels["load"]))
    n_x, n_y = PlatformGeometry.from_wheels(vehicle.wheels).active[heaviest]
    all_on, steps = np.ones(len(vehicle.wheels)), round(_EQUILIBRIUM_TIME / machine.physics_step)
    path = machine.advance(steps, 1.0, all_on, np.zeros(3))
    found = {}
    for case, (_, _, yaw, v_x, v_y, _) in {"start": path[0], "later": path[-1]}.items():
        away = math.remainder(yaw + math.atan2(n_y, n_x) - math.atan2(v_y, v_x), math.pi)
        found[f"equilibrium_angle.{case}"] = Metric(abs(math.degrees(away)), "deg")
    return found


def roller_angle_metrics(study: StudyRun, vehicle: str) -> dict[str, Metric]:
    """Return the rotation in stops with a wheel whose roller angle differs or is wrongly known.

    Args:
        study: the run of the study, which gives the experiment.
        vehicle: vehicle, whose first wheel has the angle.
    """
    wheel, mount = next(iter(study.experiments.vehicle(vehicle).wheels.items()))
    metrics: dict[str, Metric] = {}
    for error in _ANGLE_ERRORS:
        angle = f"wheels.{wheel}.roller_angle_deg={mount.roller_angle_deg + error}"
        known, own = f"brake_assist.{angle}", f"vehicle.{angle}"
        for case, variant, changes in (
            ("unassisted", "unassisted", (own, known)),
            ("unequal", "assisted", (own, known)),
            ("wrong", "assisted", (known,)),
        ):
            name = f"{case}_{'minus' if error < 0.0 else 'plus'}_{abs(error):.0f}"
            metrics[f"rotation.{name}"] = _rotation(study, vehicle, variant, *changes)
    return metrics


def fork_metrics(study: StudyRun, vehicle: str) -> dict[str, Metric]:
    """Return the rotation in stops with the load as in the vehicle's file, and raised by a fork."""
    raised = ("vehicle.fork.time=[0, 1]", f"vehicle.fork.height=[{_RAISED}, {_RAISED}]")
    return {
        f"fork_rotation.{case}_{variant}": _rotation(study, vehicle, variant, *changes)
        for variant in ("unassisted", "assisted")
        for case, changes in (("lowered", ()), ("raised", raised))
    } | {"fork_height.raised": Metric(_RAISED, "m")}


def _rotation(study: StudyRun, vehicle: str, variant: str, *changes: str) -> Metric:
    """Return the rotation in a stop of the experiment straight_line with a vehicle."""
    overrides = (f"vehicle={vehicle}", *WITHOUT_CAMERAS, *changes)
    history = run_closed_loop(study.experiments.load("straight_line", variant, overrides))
    return Metric(math.degrees(abs(float(history.pose[-1, 2] - history.pose[0, 2]))), "deg")


def locked(configuration: VehicleConfiguration, speed: float, after: float = 0.15) -> LockedWheels:
    """Return the forces on a vehicle that has begun to slide straight ahead.

    Args:
        configuration: the vehicle, on dry level ground.
        speed: speed before all brakes act [m/s].
        after: time from pressing the pedal to the evaluation of the forces [s]; the wheels are then
            locked and the loads have settled.
    """
    vehicle = Vehicle(configuration, twist=np.array([speed, 0.0, 0.0]))
    everywhere = np.ones(len(configuration.wheels))
    vehicle.advance(round(after / vehicle.physics_step), 1.0, everywhere, np.zeros(3))
    wheels = vehicle.wheels
    masses = configuration.masses
    return LockedWheels(configuration, wheels["force"].copy(), wheels["load"].copy(), masses.center)


def _draw_forces(cases: Mapping[str, LockedWheels], arrow: float = 0.55) -> Figure:
    """Draw the vehicle from above, with the forces of the locked wheels and their sum.

    The arrow of the sum has half the scale of the other arrows.

    Args:
        cases: cases, keyed by the names in `_TITLES`; the vehicle moves upwards in the figure.
        arrow: length of the longest arrow of a wheel, as a multiple of the chassis length.
    """
    title = "Locked wheels push along their rollers (the vehicle slides upwards)"
    x = "right of the middle [m]"
    y = "ahead of the middle [m]"
    figure, (panels,) = style.panels(
        title, 1, len(cases), size=(10.0, 6.4), x=x, y=y, sharex=True, sharey=True
    )
    largest = max(float(np.max(np.abs(one.force))) for one in cases.values())
    for axes, (case, one) in zip(panels, cases.items(), strict=True):
        _draw_vehicle(axes, one, arrow * one.vehicle.chassis_length / largest)
        side = "left" if one.moment > 0.0 else "right"
        turn = f"{plain(abs(one.moment))} N m of yaw moment to the {side}"
        words = turn if abs(one.moment) > 1.0 else "no yaw moment"
        axes.set_title(f"{_TITLES[case]}\n{words}")
    style.legend_below(figure, 3)
    return figure


def _draw_vehicle(axes: Axes, one: LockedWheels, scale: float) -> None:
    """Draw one case; `scale` is the ratio of arrow length to force [m/N]."""
    vehicle = one.vehicle
    scene = Scene.of_vehicle(vehicle)
    axes.add_patch(Polygon(ahead_up(scene.chassis), facecolor="#F2EBDD", edgecolor=style.GRAY))
    for outline in scene.wheel_outlines:
        axes.add_patch(Polygon(ahead_up(outline), facecolor="white", edgecolor=style.BLACK))
    arrows: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "zorder": 5}
    places, vectors = ahead_up(one.geometry.position), scale * ahead_up(one.vectors)
    axes.quiver(
        *places.T, *vectors.T, color=style.BLUE, width=0.010, label="force of a wheel", **arrows
    )
    for (x, y), load in zip(places, one.load, strict=True):
        side = 1.0 if x >= 0.0 else -1.0
        place = (x + side * 0.35 * vehicle.chassis_width, y + 0.08 * vehicle.chassis_length)
        axes.annotate(f"{plain(load)} N\nof load", place, ha="center")
    center = ahead_up(one.center[None])[0]
    # The arrow of the sum is drawn at half the scale of the wheels' arrows.
    total = 0.5 * scale * ahead_up(one.total[None])[0]
    axes.quiver(
        *center, *total, color=style.VERMILLION, width=0.014, label="sum of the forces, half scale",
        **arrows,
    )  # fmt: skip
    axes.plot(*center, "o", color=style.BLACK, zorder=6, label="center of gravity")
    axes.set_aspect("equal")
    axes.margins(0.1)
    axes.set_xlim(-1.15 * vehicle.chassis_width, 1.15 * vehicle.chassis_width)
    axes.set_ylim(-0.8 * vehicle.chassis_length, 0.75 * vehicle.chassis_length)


def _draw_manifold(manifolds: Mapping[str, SlidingManifold], speed: float) -> Figure:
    """Draw the lines of zero error for each wheel, and the number of wheels that may brake.

    Args:
        manifolds: manifolds of one vehicle, keyed by weighting; the line of motion is straight
            ahead.
        speed: speed of the vehicle along this line [m/s].
    """
    title = f"Which wheels may brake at {speed:g} m/s along the line"
    x = "velocity to the left of the line [m/s]"
    y = "yaw rate to the left [rad/s]"
    figure, (panels,) = style.panels(
        title, 1, len(manifolds), size=(11.0, 4.8), x=x, y=y, sharex=True, sharey=True
    )
    for axes, (words, manifold) in zip(panels, manifolds.items(), strict=True):
        shades = _draw_signs(axes, manifold, speed)
        axes.set_title(words)
    count = len(manifold.geometry.names)
    bar = figure.colorbar(
        shades, ax=list(panels), ticks=range(count + 1), label="wheels that brake"
    )
    bar.ax.set_ylim(-0.5, count + 0.5)
    style.legend_below(figure, 5)
    return figure


def _draw_signs(axes: Axes, manifold: SlidingManifold, speed: float) -> Any:
    """Draw the panel of one weighting and return its color mesh."""
    across = np.array([0.0, 1.0])
    drift = turn = np.linspace(-1.0, 1.0, 81)  # [m/s], [rad/s]
    errors = np.array(
        [
            [manifold.errors(np.array([speed, v, omega]), across).total for v in drift]
            for omega in turn
        ]
    )
    names = manifold.geometry.names
    braking = np.sum(errors < 0.0, axis=2)
    axes.grid(False)
    shades = axes.pcolormesh(
        drift, turn, braking, cmap="Grays", vmin=0, vmax=2 * len(names), shading="nearest"
    )
    for row, name in enumerate(names):
        # The zero lines of two wheels may coincide.
        color, dashes = style.wheel_color(row), "-" if row % 2 else "--"
        look: dict[str, Any] = {"linewidths": 2.2, "linestyles": dashes, "zorder": 3 - row % 2}
        axes.contour(drift, turn, errors[:, :, row], levels=[0.0], colors=color, **look)
        axes.plot([], [], dashes, color=color, label=f"s = 0, {name.replace('_', ' ')}")
    axes.plot(0.0, 0.0, "o", color=style.BLACK, zorder=4, label="target")
    for x, y in ((0.0, 0.72), (0.0, -0.72), (-0.72, 0.0), (0.72, 0.0)):
        twist = np.array([speed, x, y])
        brake = manifold.errors(twist, across).total < 0.0
        words = "\n".join(n.replace("_", " ") for n, one in zip(names, brake, strict=True) if one)
        words = "all" if brake.all() else words
        axes.annotate(words, (twist[1], twist[2]), ha="center", va="center", fontsize=8.5)
    return shades
