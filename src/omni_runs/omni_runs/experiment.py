"""Experiments: one typed configuration of the whole loop, with variants and overrides.

An experiment file lists only values that differ from the defaults. Parts are referred to by name:
``vehicle: mecanum_forklift`` reads ``config/vehicles/mecanum_forklift.yaml``, and a vehicle refers
to its tire in the same way. The variant is merged first, then each ``--set`` override, whose dotted
key can address any value. If a variant or an override names another file for a part, this file is
read first, and further values that are given for the part are merged into its content. ``{}`` as
the value of named entries, such as ``ground.patches={}``, removes all of them.
"""

import re
from collections.abc import Iterable, Mapping
from os.path import abspath, exists, isfile
from pathlib import Path
from typing import Any

from omni_core import configuration as declared
from omni_core.configuration import Configuration, ConfigurationError, did_you_mean, parameter
from omni_core.sensors import LineSensor
from omni_runs import yaml_files
from omni_runs.demands import read_demands
from omni_runs.experiment_configuration import ExperimentConfiguration, changed
from omni_sim.configuration import SimulationConfiguration
from omni_sim.tire.interface.configuration import TireConfiguration
from omni_sim.vehicle.configuration import VehicleConfiguration

__all__ = [
    "CONFIGURATION",
    "WITHOUT_CAMERAS",
    "ExperimentConfiguration",
    "ExperimentLibrary",
    "changed",
    "recorded_experiment",
    "short_name",
]

# Dotted keys whose value may be a file name instead of a mapping, with the folder of these files. A
# nested part must come after the part that contains it.
_PARTS = {"vehicle": "vehicles", "vehicle.tire": "tires", "ground": "grounds", "sensors": "sensors"}
_DEMANDS = "maneuver.demands"  # key whose value may be a table or a recording
_VARIANT = r"[A-Za-z][A-Za-z0-9_-]{0,63}"
# Files of a vehicle's own folder, by the configuration folder that otherwise contains such files.
_IN_FOLDER = {"vehicles": "vehicle.yaml", "experiments": "experiment.yaml"}
_EXPERIMENTS = "experiments"
# Values that every vehicle must define, in its own file or in the experiment.
_REQUIRED = (
    *("wheels", "chassis_length", "chassis_width", "body", "body.yaw_inertia"),
    *("tire", "brake", "brake.max_torque", "drive", "drive.max_torque", "drive.stiffness"),
    "wheel_inertia",
)

CONFIGURATION = "configuration.yaml"
"""Name of the file next to a recording that contains the configuration of its run."""

WITHOUT_CAMERAS = ("feedback=velocity_sensor", "simulation.render_lines=false")
"""Overrides for runs without line cameras."""


_ENTRIES = frozenset(yaml_files.named_entries(ExperimentConfiguration))


class _SensorsAlone(Configuration):
    sensors: Mapping[str, LineSensor] = parameter()
    """Line cameras, keyed by name"""


class ExperimentLibrary:
    """Reads experiments, and the files to which they refer, from a configuration folder.

    Attributes:
        folder: folder of the configuration.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def names(self) -> list[str]:
        """Return the names of the experiments, sorted."""
        return self.parts(_EXPERIMENTS)

    def variants(self, experiment: str, overrides: Iterable[str] = ()) -> list[str]:
        """Return the names of an experiment's variants, in the order of the experiment's file.

        Args:
            experiment: name of the experiment.
            overrides: ``dotted.key=value`` texts. If one of them sets the control law, variants
                that set a control law are left out, unless no variant would remain.
        """
        variants = _variants(self._read(_EXPERIMENTS, experiment, "experiment"))
        if not any(words.startswith("brake_assist.law=") for words in overrides):
            return list(variants)
        kept = [n for n, one in variants.items() if "law" not in _section(one, "brake_assist")]
        return kept or list(variants)

    def parts(self, kind: str) -> list[str]:
        """Return the names of the files in a configuration folder such as ``vehicles``, sorted."""
        return sorted(path.stem for path in (self.folder / kind).glob("*.yaml"))

    def named(self, experiment: str, part: str) -> str:
        """Return the file name that an experiment gives for a part such as ``ground``.

        The result is empty if the experiment contains the values of the part itself, or does not
        mention it.
        """
        found = self._read(_EXPERIMENTS, experiment, "experiment").get(part)
        return found if isinstance(found, str) else ""

    def load(
        self, experiment: str, variant: str | None = None, overrides: Iterable[str] = ()
    ) -> ExperimentConfiguration:
        """Return the checked configuration of one variant of an experiment.

        Args:
            experiment: name of a file in ``experiments/``, a path that ends in ``.yaml``, or a
                folder that contains ``experiment.yaml``.
            variant: name of one of the experiment's variants; by default, the last one in the file.
            overrides: ``dotted.key=value`` texts with values in YAML; later ones take precedence.

        Raises:
            ConfigurationError: a name, key or value is invalid; the message names it.
        """
        experiment = self.located(_EXPERIMENTS, experiment)
        document = self._read(_EXPERIMENTS, experiment, "experiment")
        variants = _variants(document)
        variant = list(variants)[-1] if variant is None else variant
        if variant not in variants:
            raise ConfigurationError(
                "variant",
                f"{variant!r} is not a variant of {experiment}; known: {', '.join(variants)}"
                f"{did_you_mean(variant, variants)}",
            )
        tree = {key: value for key, value in document.items() if key != "variants"}
        near = Path(experiment).parent if experiment.endswith(".yaml") else None
        tree = yaml_files.emptied(self._resolve(tree, near=near), _ENTRIES)
        changes = variants[variant] if variants[variant] is not None else {}
        if not isinstance(changes, Mapping):
            raise ConfigurationError(
                declared.join_key("variants", variant),
                f"{changes!r} is not a mapping of names to values",
            )
        # Values of a part are merged into the part that is named last, even if the values precede
        # its name.
        named: dict[str, str] = {}
        given = changes, *map(yaml_files.parse_override, overrides)
        layers = [_take_names(one, named) for one in given]
        names = [yaml_files.nest(path, named[path]) for path in _PARTS if path in named]
        for layer in (*names, *layers):
            values = yaml_files.emptied(self._resolve(layer, near=near), _ENTRIES)
            tree = yaml_files.merge(tree, values)
        # Nodes use the true mounting positions unless the experiment configures others.
        for kind in ("sensors", "flow_sensors"):
            set_default(tree, "odometry", kind, tree.get(kind))
        vehicle = _section(tree, "vehicle")
        if isinstance(tree.get("vehicle"), Mapping):
            check_complete(vehicle, _REQUIRED, "vehicle", experiment)
        for name in ("wheels", "brake", "wheel_inertia"):
            set_default(tree, "brake_assist", name, vehicle.get(name))
        _share_period(tree)
        set_default(tree, "brake_assist", "feedback_delay", _twist_delay(tree))
        return declared.from_mapping(ExperimentConfiguration, tree)

    def vehicle(self, name: str) -> VehicleConfiguration:
        """Return the configuration of a vehicle that is not part of an experiment.

        Args:
            name: name of a file in ``vehicles/``, a path that ends in ``.yaml``, or a folder that
                contains ``vehicle.yaml``.

        Raises:
            ConfigurationError: the name, a key or a value is invalid.
        """
        return declared.from_mapping(VehicleConfiguration, self.vehicle_values(name), "vehicle")

    def vehicle_values(self, name: str) -> dict[str, Any]:
        """Return the nested values of a vehicle's file and of the files to which it refers.

        Args:
            name: name of the vehicle, as in `vehicle`.
        """
        return yaml_files.plain(self._resolve({"vehicle": name})["vehicle"])

    def tire(self, name: str) -> TireConfiguration:
        """Return the tire in a file in ``tires/`` or at a path, whether or not it fits a vehicle.

        Raises:
            ConfigurationError: the name, a key or a value is invalid.
        """
        tree = self._resolve({"tire": name}, "vehicle")
        return declared.from_mapping(TireConfiguration, tree["tire"], "tire")

    def sensors(self, name: str) -> Mapping[str, LineSensor]:
        """Return the line cameras in a file, keyed by name; they need not suffice for a twist.

        Args:
            name: name of a file in ``sensors/``, or a path that ends in ``.yaml``.

        Raises:
            ConfigurationError: the name, a key or a value is invalid.
        """
        return declared.from_mapping(_SensorsAlone, self._resolve({"sensors": name})).sensors

    def camera(self, name: str) -> LineSensor:
        """Return the first of the line cameras that `sensors` returns."""
        return next(iter(self.sensors(name).values()))

    def _resolve(
        self, tree: Mapping[str, Any], prefix: str = "", near: Path | None = None
    ) -> dict[str, Any]:
        """Return nested values in which the name of a part is replaced by the content of its file.

        Args:
            tree: nested values of an experiment or a part.
            prefix: dotted path of `tree`.
            near: folder to which paths may be relative; None for the working directory.
        """
        resolved: dict[str, Any] = {}
        for key, value in tree.items():
            path = declared.join_key(prefix, str(key))
            if path == _DEMANDS and isinstance(value, str):
                file = (near or Path()) / value
                demands = read_demands(file if exists(file) else Path(value), path)
                resolved[key] = yaml_files.Part(demands)
                continue
            kind = _PARTS.get(path)
            if kind is not None and isinstance(value, str):
                named = _nearest(self.located(kind, value), near)
                part = self._read(kind, named, path)
                beside = Path(named).parent if named.endswith(".yaml") else None
                resolved[key] = yaml_files.Part(self._resolve(part, path, beside))
                if kind == "vehicles":
                    check_complete(resolved[key], _REQUIRED, path, named)
            elif isinstance(value, Mapping):
                resolved[key] = self._resolve(value, path, near)
            else:
                resolved[key] = value
        return resolved

    def located(self, kind: str, name: str) -> str:
        """Return the path of the file in the folder of a vehicle or experiment.

        If `name` is not such a folder, `name` is returned unchanged.

        Args:
            kind: configuration folder that usually contains such files, such as ``vehicles``.
            name: folder made by ``./omni new-vehicle``, or another name or path.
        """
        if kind not in _IN_FOLDER or name.endswith(".yaml"):
            return name
        file = Path(name) / _IN_FOLDER[kind]
        # Unlike a path's is_file(), isfile() accepts names that are too long.
        return str(file) if isfile(file) and name not in self.parts(kind) else name

    def _read(self, kind: str, name: str, key: str) -> dict[str, Any]:
        name = self.located(kind, name)
        if name.endswith(".yaml"):
            path = Path(name)
        else:
            path = self.folder / kind / f"{name}.yaml"
            known = self.parts(kind)
            if not path.parent.is_dir():
                problem = f"cannot look for {name!r}: the folder {path.parent} does not exist"
                raise ConfigurationError(key, problem)
            if name not in known:
                hint = did_you_mean(name, known)
                own = ", or a folder with " + _IN_FOLDER[kind] if kind in _IN_FOLDER else ""
                raise ConfigurationError(
                    key,
                    f"{name!r} is not known{hint or ';'} known: {', '.join(known)}; or give a "
                    f"path that ends in .yaml{own}",
                )
        return yaml_files.read_mapping(path, key)


def recorded_experiment(path: Path, overrides: Iterable[str] = ()) -> ExperimentConfiguration:
    """Return the configuration that is stored with a recording, with overrides applied.

    Args:
        path: a ``configuration.yaml`` written by a run.
        overrides: ``dotted.key=value`` texts with values in YAML; later ones take precedence.

    Raises:
        ConfigurationError: the file is not such a configuration, or a key or value is invalid.
    """
    tree = yaml_files.read_mapping(path, "configuration")
    for override in overrides:
        values = yaml_files.emptied(yaml_files.parse_override(override), _ENTRIES)
        tree = yaml_files.merge(tree, values)
    _share_period(tree)
    return declared.from_mapping(ExperimentConfiguration, tree)


def short_name(path: str | Path) -> str:
    """Return the short name of an experiment or vehicle: the name of its file or folder.

    Args:
        path: a name, a path that ends in ``.yaml``, or a folder made by ``./omni new-vehicle``.
    """
    file = Path(path)
    if file.name in _IN_FOLDER.values():
        return Path(abspath(file)).parent.name
    return file.name.removesuffix(".yaml")


def _nearest(name: str, near: Path | None) -> str:
    """Return the path of the YAML file `name` in the folder `near`.

    If `near` is None or does not contain this file, `name` is returned unchanged.
    """
    if near is not None and name.endswith(".yaml") and isfile(near / name):
        return str(near / name)
    return name


def check_complete(
    vehicle: Mapping[str, Any], required: Iterable[str], key: str, name: str
) -> None:
    """Check that a vehicle defines all values that have no sensible default.

    Args:
        vehicle: nested values of the vehicle.
        required: dotted keys of these values.
        key: dotted key of the vehicle, for the error message.
        name: name or file of the vehicle, for the error message.

    Raises:
        ConfigurationError: a value is missing, or a key is unknown, perhaps a misspelled one.
    """
    for one in required:
        value: Any = vehicle
        for part in one.split("."):
            value = value.get(part) if isinstance(value, Mapping) else vehicle
        if value is None:
            try:
                declared.from_mapping(VehicleConfiguration, vehicle, key)
            except declared.ConfigurationError as error:
                if isinstance(error, declared.UnknownKeyError):
                    raise
            raise declared.ConfigurationError(
                declared.join_key(key, one),
                f"is missing in {name} and has no default; measure it, or use the estimate of "
                "./omni new-vehicle",
            )


def _take_names(
    layer: Mapping[str, Any], named: dict[str, str], prefix: str = ""
) -> dict[str, Any]:
    """Return the values of a layer without the file names of parts, which are added to `named`.

    Args:
        layer: nested values of an experiment, a variant or an override.
        named: file names of parts, keyed by the dotted key of the part; changed in place.
        prefix: dotted key of `layer` in the experiment.
    """
    rest: dict[str, Any] = {}
    for key, value in layer.items():
        path = declared.join_key(prefix, str(key))
        if path in _PARTS and isinstance(value, str):
            named[path] = value
        else:
            nested = isinstance(value, Mapping)
            rest[key] = _take_names(value, named, path) if nested else value
    return rest


def set_default(tree: dict[str, Any], node: str, name: str, truth: Any) -> None:
    """Set a parameter of a node to the simulator's value, unless the experiment sets it.

    Args:
        tree: experiment, changed in place.
        node: section of the node, such as ``odometry``.
        name: key in this section.
        truth: value of the simulator.
    """
    configured = tree.get(node, {})
    if isinstance(configured, Mapping) and truth is not None:
        tree[node] = yaml_files.merge({name: truth}, configured)


def _section(tree: Any, name: str) -> Mapping[str, Any]:
    """Return a section of nested values; empty if there is none, or if it is no mapping."""
    found = tree.get(name) if isinstance(tree, Mapping) else None
    return found if isinstance(found, Mapping) else {}


def _variants(document: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the variants of an experiment, keyed by name, after a check of their names."""
    if "wheels" in document:
        problem = "this file describes a vehicle; give it as --vehicle or --set vehicle=FILE"
        raise ConfigurationError("experiment", problem)
    variants = document.get("variants")
    if not isinstance(variants, Mapping) or not variants:
        raise ConfigurationError("variants", "an experiment needs at least one named variant")
    for name in variants:
        # The name is used as the name of a folder.
        if not isinstance(name, str) or not re.fullmatch(_VARIANT, name):
            raise ConfigurationError(
                "variants",
                f"{str(name)[:40]!r} is not a valid name (a letter, then letters, digits, '_' "
                "or '-')",
            )
    return variants


def _share_period(tree: dict[str, Any]) -> None:
    """Give the assistant the control period of the simulation, unless the experiment sets it."""
    period = _section(tree, "simulation").get("control_period")
    set_default(tree, "brake_assist", "control_period", period)


def _twist_delay(tree: Mapping[str, Any]) -> float | None:
    """Return the delay of the odometry's twist relative to its stamp [s]; None if unknown.

    The twist is the mean over the lines of a control period and has the stamp of the newest line.
    Its delay is therefore half a control period.
    """
    if tree.get("feedback", "optical") != "optical":
        return None
    configured = _section(tree, "simulation").get("control_period")
    period = SimulationConfiguration().control_period if configured is None else configured
    longest = 0.4  # s; twice the limit on `feedback_delay`
    usable = isinstance(period, int | float) and 0.0 < period <= longest
    return 0.5 * period if usable else None
