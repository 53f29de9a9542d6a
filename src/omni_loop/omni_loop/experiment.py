"""Experiments: one typed configuration for the whole loop, its variants, and overrides.

An experiment file lists only values that differ from the defaults. Parts are referred to by name:
``vehicle: mecanum_forklift`` reads ``config/vehicles/mecanum_forklift.yaml``, and a vehicle refers
to its tire in the same way. First the variant is merged into the result, then each ``--set``
override, whose dotted key can reach every value. If a variant or an override names another part,
that part is read first, and the other values of the part are merged into it.
"""

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from linescan_odometry.odometry import OdometryConfiguration
from linescan_odometry.registry import ODOMETRY_GROUP, make_odometry
from linescan_odometry.twist.least_squares import check_placement
from omni_brake_assist.brake_assist import BrakeAssistConfiguration
from omni_brake_assist.laws.registry import own_law
from omni_loop.demands import read_demands
from omni_loop.yaml_files import load_yaml, read_mapping
from omni_platform import geometry, plugins
from omni_platform.configuration import (
    Configuration,
    ConfigurationError,
    did_you_mean,
    from_mapping,
    join_key,
    parameter,
)
from omni_platform.sensors import LineSensor
from omni_sim.configuration import SimulationConfiguration, SimulatorConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.mujoco_vehicle import load_mujoco

# Dotted keys whose value may be the name of a file instead of a mapping, with the folder of the
# file. A nested part comes after the part that contains it.
_PARTS = {"vehicle": "vehicles", "vehicle.tire": "tires", "ground": "grounds", "sensors": "sensors"}
_DEMANDS = "maneuver.demands"  # key whose value may be a table or a recording
_VARIANT = r"[A-Za-z][A-Za-z0-9_-]{0,63}"
# Files of a vehicle's own folder, by kind.
_IN_FOLDER = {"vehicles": "vehicle.yaml", "experiments": "experiment.yaml"}
_EXPERIMENTS = "experiments"
# Values that a vehicle must define, in its own file or in an experiment.
_REQUIRED = (
    *("wheels", "chassis_length", "chassis_width", "body", "body.yaw_inertia"),
    *("tire", "brake", "brake.max_torque", "drive", "drive.max_torque", "drive.stiffness"),
    "wheel_inertia",
)

FEEDBACKS = ("optical", "velocity_sensor")
"""Built-in sources of the twist for the brake assistant."""


class ExperimentConfiguration(SimulatorConfiguration):
    """Everything that one run of the loop depends on."""

    description: str = parameter("")
    """What the experiment shows"""
    feedback: str = parameter("optical")
    """Source of the assistant's twist: optical is the line-scan odometry, velocity_sensor the noisy
    sampled velocity sensor (60), (61); my_module:MyOdometry is a class of your own that receives
    the lines, see docs/extending.md"""
    odometry: OdometryConfiguration = parameter()
    """Line-scan odometry"""
    brake_assist: BrakeAssistConfiguration = parameter()
    """Brake assistant"""

    @property
    def uses_lines(self) -> bool:
        """Whether the brake assistant uses a twist from the lines of the cameras."""
        return self.feedback != "velocity_sensor"

    @property
    def twist_period(self) -> float:
        """Time between two twists that the assistant receives [s]; 0 for a twist in every step."""
        return 0.0 if self.uses_lines else self.velocity_sensor.sample_time

    @property
    def own_odometry(self) -> str:
        """Name of the user's odometry class, empty for the built-in odometry."""
        return "" if self.feedback in FEEDBACKS else self.feedback

    def check_consistency(self) -> None:
        """Raise an error if a node would wait for messages that no node publishes.

        Nodes must be configured with the names of the vehicle's wheels and line cameras. The
        configured positions may differ from the true ones, to study such errors.

        Raises:
            ConfigurationError: names of wheels or cameras differ, or the feedback does not fit.
        """
        super().check_consistency()
        plugins.check_name("feedback", self.feedback, FEEDBACKS, ODOMETRY_GROUP)
        _check_names("brake_assist.wheels", self.brake_assist.wheels, self.vehicle.wheels)
        _check_names("odometry.sensors", self.odometry.sensors, self.sensors)
        _check_names("odometry.flow_sensors", self.odometry.flow_sensors, self.flow_sensors)
        rates = [sensor.rate for sensor in self.flow_sensors.values()]
        if not self.sensors and max(rates, default=0.0) * self.simulation.control_period < 1.0:
            raise ConfigurationError(
                "flow_sensors",
                "without line cameras, one must measure in every control period of "
                f"{self.simulation.control_period:g} s; set its rate",
            )
        if self.uses_lines and not self.simulation.render_lines:
            raise ConfigurationError(
                "simulation.render_lines",
                "must be true for optical feedback; feedback=velocity_sensor needs no lines",
            )

    def check_drivable(self) -> None:
        """Raise an error if the odometry needs an axle or a user's class cannot be created.

        A simulated vehicle has no axle that resists lateral slip. A recorded vehicle may have one,
        so this is not checked for replays.

        Raises:
            ConfigurationError: the odometry needs such an axle for its twist, a user's law or
                odometry cannot be imported or created, or MuJoCo is not installed.
        """
        if self.vehicle.wheel_model == "mujoco":
            load_mujoco()
        own_law(self.brake_assist, geometry.PlatformGeometry.from_wheels(self.brake_assist.wheels))
        if self.own_odometry:
            make_odometry(self.own_odometry, self.odometry)
        odometry = self.odometry
        if self.feedback != "optical" or odometry.kinematics.axle is None:
            return
        try:
            check_placement(odometry.all_sensors, odometry.minimum_lever)
        except ConfigurationError:
            raise ConfigurationError(
                "odometry.kinematics.constraint",
                "wheels with rollers slip sideways, so no axle of this vehicle can replace a "
                f"sensor; {', '.join(odometry.all_sensors)} must measure the twist by themselves",
            ) from None


class _SensorsAlone(Configuration):
    sensors: Mapping[str, LineSensor] = parameter()
    """Line cameras by name"""


class ExperimentLibrary:
    """Reads experiments and their parts from a configuration folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def names(self) -> list[str]:
        """Return the names of the experiments, sorted."""
        return self.parts(_EXPERIMENTS)

    def variants(self, experiment: str, overrides: Iterable[str] = ()) -> list[str]:
        """Return the names of an experiment's variants, in the order of its file.

        Args:
            experiment: name of the experiment.
            overrides: ``dotted.key=value`` texts; if one replaces the control law, variants that
                differ in their law are left out.
        """
        variants = _variants(self._read(_EXPERIMENTS, experiment, "experiment"))
        if not any(words.startswith("brake_assist.law=") for words in overrides):
            return list(variants)
        kept = [name for name, tree in variants.items() if not _has_law(tree)]
        return kept or list(variants)

    def parts(self, kind: str) -> list[str]:
        """Return the names of the files of a kind, such as ``vehicles``, sorted."""
        return sorted(path.stem for path in (self._folder / kind).glob("*.yaml"))

    def named(self, experiment: str, part: str) -> str:
        """Return the name of an experiment's part, such as ``ground``; empty if it is inline."""
        found = self._read(_EXPERIMENTS, experiment, "experiment").get(part)
        return found if isinstance(found, str) else ""

    def load(
        self, experiment: str, variant: str, overrides: Iterable[str] = ()
    ) -> ExperimentConfiguration:
        """Compose and check the configuration of one variant.

        Args:
            experiment: name of a file in ``experiments/``, a path that ends in ``.yaml``, or a
                folder with an ``experiment.yaml``.
            variant: one of the experiment's variants.
            overrides: ``dotted.key=value`` texts, the value in YAML; later ones win.

        Raises:
            ConfigurationError: a name, key or value does not fit; the message names it.
        """
        experiment = self._located(_EXPERIMENTS, experiment)
        document = self._read(_EXPERIMENTS, experiment, "experiment")
        variants = _variants(document)
        if variant not in variants:
            raise ConfigurationError(
                "variant",
                f"{variant!r} is not a variant of {experiment}; known: {', '.join(variants)}"
                f"{did_you_mean(variant, variants)}",
            )
        tree = {key: value for key, value in document.items() if key != "variants"}
        near = Path(experiment).parent if experiment.endswith(".yaml") else None
        tree = self._resolve(tree, near=near)
        changes = variants[variant] if variants[variant] is not None else {}
        if not isinstance(changes, Mapping):
            raise ConfigurationError(
                join_key("variants", variant), f"{changes!r} is not a mapping of names to values"
            )
        # Values of a part are merged into the last named part, also if they come before the name.
        named: dict[str, str] = {}
        layers = [_take_names(one, named) for one in (changes, *map(parse_override, overrides))]
        names = [_nest(path, named[path]) for path in _PARTS if path in named]
        for layer in (*names, *layers):
            tree = merge(tree, self._resolve(layer, near=near))
        # Nodes use the true mounting unless an experiment configures another one.
        for kind in ("sensors", "flow_sensors"):
            _set_default(tree, "odometry", kind, tree.get(kind))
        vehicle = tree.get("vehicle")
        wheels = vehicle.get("wheels") if isinstance(vehicle, Mapping) else None
        _set_default(tree, "brake_assist", "wheels", wheels)
        if isinstance(vehicle, Mapping):
            _check_complete(vehicle, "vehicle", experiment)
            _set_default(tree, "brake_assist", "brake", vehicle.get("brake"))
            _set_default(tree, "brake_assist", "wheel_inertia", vehicle.get("wheel_inertia"))
        _set_default(tree, "brake_assist", "feedback_delay", _twist_delay(tree))
        return from_mapping(ExperimentConfiguration, tree)

    def vehicle(self, name: str) -> VehicleConfiguration:
        """Read a vehicle alone.

        Args:
            name: name of a file in ``vehicles/``, a path that ends in ``.yaml``, or a folder with a
                ``vehicle.yaml``.

        Raises:
            ConfigurationError: the name, a key or a value does not fit.
        """
        return from_mapping(VehicleConfiguration, self.vehicle_values(name), "vehicle")

    def vehicle_values(self, name: str) -> dict[str, Any]:
        """Return the values in a vehicle's file, with the content of the files that it names.

        Args:
            name: name of the vehicle, as for `vehicle`.
        """
        return _plain(self._resolve({"vehicle": name})["vehicle"])

    def sensors(self, name: str) -> Mapping[str, LineSensor]:
        """Read line cameras alone, even if no twist can be computed from their placement.

        Args:
            name: name of a file in ``sensors/``, or a path that ends in ``.yaml``.

        Raises:
            ConfigurationError: the name, a key or a value does not fit.
        """
        return from_mapping(_SensorsAlone, self._resolve({"sensors": name})).sensors

    def _resolve(
        self, tree: Mapping[str, Any], prefix: str = "", near: Path | None = None
    ) -> dict[str, Any]:
        """Replace the names of parts by the parts; paths may be relative to `near`."""
        resolved: dict[str, Any] = {}
        for key, value in tree.items():
            path = join_key(prefix, str(key))
            if path == _DEMANDS and isinstance(value, str):
                file = (near or Path()) / value
                resolved[key] = _Part(read_demands(file if file.exists() else Path(value), path))
                continue
            kind = _PARTS.get(path)
            if kind is not None and isinstance(value, str):
                named = _nearest(self._located(kind, value), near)
                part = self._read(kind, named, path)
                if kind == "vehicles":
                    _check_complete(part, path, named)
                beside = Path(named).parent if named.endswith(".yaml") else None
                resolved[key] = _Part(self._resolve(part, path, beside))
            elif isinstance(value, Mapping):
                resolved[key] = self._resolve(value, path, near)
            else:
                resolved[key] = value
        return resolved

    def _located(self, kind: str, name: str) -> str:
        """Return the file for a folder that ``./omni new-vehicle`` wrote, other names unchanged."""
        file = Path(name) / _IN_FOLDER.get(kind, "")
        known = name.endswith(".yaml") or (self._folder / kind / f"{name}.yaml").is_file()
        return name if known or kind not in _IN_FOLDER or not file.is_file() else str(file)

    def _read(self, kind: str, name: str, key: str) -> dict[str, Any]:
        name = self._located(kind, name)
        if name.endswith(".yaml"):
            path = Path(name)
        else:
            path = self._folder / kind / f"{name}.yaml"
            known = self.parts(kind)
            if name not in known:
                hint = did_you_mean(name, known)
                raise ConfigurationError(
                    key,
                    f"{name!r} is not known{hint or ';'} known: {', '.join(known)}",
                )
        return read_mapping(path, key)


def recorded_experiment(path: Path, overrides: Iterable[str] = ()) -> ExperimentConfiguration:
    """Return the effective configuration stored with a recording, with overrides.

    Args:
        path: a ``configuration.yaml`` as a run writes it.
        overrides: ``dotted.key=value`` texts, the value in YAML; later ones win.

    Raises:
        ConfigurationError: the file is no such configuration, or a key or value does not fit.
    """
    tree = read_mapping(path, "configuration")
    for override in overrides:
        tree = merge(tree, parse_override(override))
    return from_mapping(ExperimentConfiguration, tree)


def _nearest(name: str, near: Path | None) -> str:
    """Resolve a path relative to the file that contains it; return other names unchanged."""
    if near is not None and name.endswith(".yaml") and (near / name).is_file():
        return str(near / name)
    return name


def _check_complete(vehicle: Mapping[str, Any], key: str, name: str) -> None:
    """Raise an error if a vehicle lacks values that have no sensible default."""
    for required in _REQUIRED:
        value: Any = vehicle
        for part in required.split("."):
            value = value.get(part) if isinstance(value, Mapping) else vehicle
        if value is None:
            raise ConfigurationError(
                join_key(key, required),
                f"is missing in {name} and has no default; measure it, or use the estimate of "
                "./omni new-vehicle",
            )


class _Part(dict[str, Any]):
    """A part read from a file: it replaces the previous value instead of being merged with it."""


def parse_override(text: str) -> dict[str, Any]:
    """Return ``vehicle.load.mass=400`` as nested mappings.

    Raises:
        ConfigurationError: there is no ``=``, no key, or the value is not YAML.
    """
    key, equals, value_text = text.partition("=")
    parts = key.strip().split(".")
    if not equals or not all(parts) or len(parts) > 20:
        raise ConfigurationError(
            "--set", f"{text[:200]!r} must have the form key=value, such as vehicle.load.mass=400"
        )
    try:
        value = load_yaml(value_text)
    except (yaml.YAMLError, ValueError):  # ValueError: a date such as 2020-13-01
        raise ConfigurationError(key, f"the value {value_text[:200]!r} is not valid YAML") from None
    return _nest(key.strip(), value)


def _nest(path: str, value: Any) -> dict[str, Any]:
    for part in reversed(path.split(".")):
        value = {part: value}
    return dict(value)


def _plain(tree: Mapping[str, Any]) -> dict[str, Any]:
    return {key: _plain(one) if isinstance(one, Mapping) else one for key, one in tree.items()}


def _take_names(
    layer: Mapping[str, Any], named: dict[str, str], prefix: str = ""
) -> dict[str, Any]:
    """Return a layer without the names of parts, which are stored in `named` by path."""
    rest: dict[str, Any] = {}
    for key, value in layer.items():
        path = join_key(prefix, str(key))
        if path in _PARTS and isinstance(value, str):
            named[path] = value
        else:
            nested = isinstance(value, Mapping)
            rest[key] = _take_names(value, named, path) if nested else value
    return rest


def _has_law(variant: Any) -> bool:
    part = variant.get("brake_assist") if isinstance(variant, Mapping) else None
    return isinstance(part, Mapping) and "law" in part


def _variants(document: Mapping[str, Any]) -> Mapping[str, Any]:
    variants = document.get("variants")
    if not isinstance(variants, Mapping) or not variants:
        raise ConfigurationError("variants", "an experiment needs at least one named variant")
    for name in variants:
        # The name becomes that of a folder.
        if not isinstance(name, str) or not re.fullmatch(_VARIANT, name):
            raise ConfigurationError(
                "variants",
                f"{str(name)[:40]!r} is no name of letters, digits, '_' and '-' that begins with a "
                "letter",
            )
    return variants


def _set_default(tree: dict[str, Any], node: str, name: str, truth: Any) -> None:
    """Set a value of a node to the true value unless the tree configures it."""
    configured = tree.get(node, {})
    if isinstance(configured, Mapping) and truth is not None:
        tree[node] = merge({name: truth}, configured)


def _twist_delay(tree: Mapping[str, Any]) -> float | None:
    """Return the delay of the odometry's twist relative to its stamp [s]; None if unknown.

    The twist is the mean over a batch of lines, stamped with the newest: the delay is half a batch.
    """
    if tree.get("feedback", "optical") != "optical":
        return None
    simulation = tree.get("simulation", {})
    configured = simulation.get("control_period") if isinstance(simulation, Mapping) else None
    period = SimulationConfiguration().control_period if configured is None else configured
    longest = 0.4  # [s], twice the largest `feedback_delay`
    usable = isinstance(period, int | float) and 0.0 < period <= longest
    return 0.5 * period if usable else None


def _check_names(key: str, names: Iterable[str], known: Iterable[str]) -> None:
    if set(names) != set(known):
        raise ConfigurationError(
            key, f"has the names {', '.join(names)}, must have: {', '.join(known)}"
        )


def merge(base: Mapping[str, Any], layer: Mapping[str, Any]) -> dict[str, Any]:
    """Return `base` with the values of `layer`, which are merged mapping by mapping."""
    merged = dict(base)
    for key, value in layer.items():
        below = merged.get(key)
        if isinstance(value, Mapping) and isinstance(below, Mapping) and type(value) is dict:
            merged[key] = merge(below, value)
        else:
            merged[key] = value
    return merged
