"""Reference of all parameters, generated from their declarations.

``python -m omni_bringup.reference.parameters > docs/parameters.md`` updates the page.
"""

import dataclasses
import sys
from collections.abc import Iterator
from typing import Any

from omni_core import configuration

_AS = "as"
_HEAD = """\
# Parameters

This page lists the parameters of nodes and experiments with default, range, unit and meaning.
It is generated from the code by `python -m omni_bringup.reference.parameters`; do not edit it.
The READMEs of the packages list the parameters for the communication of each node, such as its
timeouts, and those of the nodes `recorder` and `driver`.
`<name>` stands for the name of a wheel, sensor or patch, and `*` for all parameters of a group.
As ROS parameters the names themselves are listed in `wheels.names`, `sensors.names` and so on.
Words with a slash between them are those of two parameters in one row, in this order.
A range `(0, 1]` includes 1 but not 0.
Section, equation and table numbers refer to the dissertation.
"""


def reference() -> str:
    """Return the reference of all parameters as Markdown text."""
    from linescan_odometry.configuration import OdometryConfiguration
    from omni_brake_assist.configuration import BrakeAssistConfiguration
    from omni_runs.experiment import ExperimentConfiguration
    from omni_sim.configuration import SimulatorConfiguration
    from omni_vehicle.brake_adapter import BrakeAdapterConfiguration
    from omni_vehicle.brake_adapter_node import TopicsConfiguration
    from omni_vehicle.camera.configuration import CameraConfiguration
    from omni_vehicle.controller_switch import SwitchConfiguration
    from omni_vehicle.flow_chips import FlowChipConfiguration
    from omni_vehicle.flow_sensor_node import FlowNodeConfiguration
    from omni_vehicle.twist_adapter import TwistAdapterConfiguration

    sections: dict[str, type[configuration.Configuration]] = {
        "Node `simulator` (package `omni_sim`)\n": SimulatorConfiguration,
        "Node `linescan_odometry`\n": OdometryConfiguration,
        "Node `line_camera` (package `omni_vehicle`)\n": CameraConfiguration,
        "Node `brake_assist` (package `omni_brake_assist`)\n": BrakeAssistConfiguration,
        "Experiment\n\nThe keys of `config/experiments/*.yaml` and of `--set` are those of the "
        "`simulator` and:\n": ExperimentConfiguration,
        "Node `brake_adapter` (package `omni_vehicle`)\n": BrakeAdapterConfiguration,
        "Topics of `brake_adapter`\n": TopicsConfiguration,
        "Controllers of `brake_adapter`\n": SwitchConfiguration,
        "Node `flow_sensor` (package `omni_vehicle`)\n": FlowChipConfiguration,
        "Readings of `flow_sensor`\n": FlowNodeConfiguration,
        "Node `twist_adapter` (package `omni_vehicle`)\n": TwistAdapterConfiguration,
    }
    head = "| parameter | default | range and unit | meaning |\n|---|---|---|---|"
    listed: dict[Any, str] = {}
    tables = []
    for title, cls in sections.items():
        rows = "".join(f"{row}\n" for row in _merged(_rows(cls, title.split("`")[1], listed)))
        tables.append(f"## {title}\n{head}\n{rows}")
        listed[cls] = f"all parameters of `{title.split('`')[1]}`"
    return "\n".join((_HEAD, *tables))


def _rows(cls: Any, node: str, listed: dict[Any, str], prefix: str = "") -> Iterator[str]:
    """Yield the rows of a configuration.

    Args:
        cls: the configuration.
        node: node of the section.
        listed: where the parameters of a configuration are listed, keyed by its class; the nested
            configurations of `cls` are added.
        prefix: dotted path of the configuration.
    """
    own = {name: _row(name, cls) for name, _, _ in configuration.declared_parameters(cls)}
    inherited: set[str] = set()
    for base in (one for one in cls.__mro__[1:] if one in listed):
        names = [name for name, _, _ in configuration.declared_parameters(base)]
        same = [n for n in names if own[n] == _row(n, base) and n not in inherited]
        inherited.update(same)
        if same and listed[base].startswith(_AS):  # the introduction of a section names other bases
            keys = ", ".join(f"`{configuration.join_key(prefix, name)}`" for name in same)
            yield f"| {keys} | | | {listed[base]} |"
    for name, kind, _ in configuration.declared_parameters(cls):
        element = configuration.element_configuration(kind)
        group = kind if configuration.is_configuration(kind) else element
        key = configuration.join_key(prefix, f"{name}.<name>" if element else name)
        if name in inherited:
            continue
        if group is None:
            yield f"| `{key}` {own[name]}"
        elif group in listed:
            yield f"| `{key}.*` | | | {listed[group]} |"
        else:
            listed[group] = f"{_AS} `{key}.*` of `{node}`"
            yield from _rows(group, node, listed, key)
            for base in group.__mro__[1:-1]:
                listed.setdefault(base, listed[group])


def _merged(rows: Iterator[str]) -> list[str]:
    """Return rows in which two parameters share a row if at most two words of the meaning differ.

    Such parameters are, for example, the two coordinates of a position.
    """
    merged: list[str] = []
    for row in rows:
        old, new = (line[2:-2].split(" | ") for line in (merged[-1] if merged else row, row))
        pairs = list(zip(old[-1].split(), new[-1].split(), strict=False))
        differing = [i for i, (one, other) in enumerate(pairs) if one != other]
        lengths = {len(old[-1].split()), len(new[-1].split())}
        few = 1 <= len(differing) <= 2 < len(pairs)
        if old[1:-1] == new[1:-1] and few and len(lengths) == 1:
            words = (one if one == other else f"{one} / {other}" for one, other in pairs)
            merged[-1] = f"| {old[0]}, {' | '.join((*new[:-1], ' '.join(words)))} |"
        else:
            merged.append(row)
    return merged


def _row(name: str, cls: Any) -> str:
    """Return default, range and description of a parameter of a configuration."""
    (info,) = (info for key, _, info in configuration.declared_parameters(cls) if key == name)
    default = cls.__dataclass_fields__[name].default
    shown = "required" if default is dataclasses.MISSING else f"`{_in_yaml(default)}`"
    if info.choices is not None:
        permitted = ", ".join(f"`{choice}`" for choice in info.choices)
    elif info.minimum is None and info.above is None:
        permitted = ""
    else:
        low = f"[{info.minimum:g}" if info.above is None else f"({info.above:g}"
        permitted = f"{low}, inf)" if info.maximum is None else f"{low}, {info.maximum:g}]"
    values = f"{permitted} {info.unit}".strip()
    return f"| {shown} | {values} | {info.description} |"


def _in_yaml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, tuple):
        return f"[{', '.join(_in_yaml(entry) for entry in value)}]"
    return str(value) if value != "" else "''"


if __name__ == "__main__":
    sys.stdout.write(reference())
