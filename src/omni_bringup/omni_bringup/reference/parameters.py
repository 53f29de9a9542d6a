"""Reference of all parameters, generated from their declarations.

``python -m omni_bringup.reference.parameters > docs/parameters.md`` updates the page.
"""

import dataclasses
import sys
import typing
from collections.abc import Iterator
from typing import Any

from omni_core import configuration
from omni_core.configuration import ParameterInfo

_HEAD = """\
# Parameters

This page lists the parameters of experiments and nodes with default, unit, range and meaning.
It is generated from the code by `python -m omni_bringup.reference.parameters`; do not edit it.
The READMEs of the packages list the parameters for the communication of each node, such as its
timeouts, and those of the nodes `recorder`, `player` and `driver`.
`<name>` stands for the name of a wheel, sensor or patch.
As ROS parameters the names themselves are listed in `wheels.names`, `sensors.names` and so on.
Section, equation and table numbers refer to the dissertation.
"""


def reference() -> str:
    """Return the reference of all parameters as Markdown text."""
    from linescan_odometry.odometry import OdometryConfiguration
    from omni_brake_assist.configuration import BrakeAssistConfiguration
    from omni_runs.experiment import ExperimentConfiguration
    from omni_sim.configuration import SimulatorConfiguration
    from omni_vehicle.brake_adapter import BrakeAdapterConfiguration
    from omni_vehicle.brake_adapter_node import TopicsConfiguration
    from omni_vehicle.camera.configuration import CameraConfiguration
    from omni_vehicle.flow_chips import FlowChipConfiguration
    from omni_vehicle.flow_sensor_node import FlowNodeConfiguration
    from omni_vehicle.twist_adapter_node import TwistAdapterConfiguration

    keys = "The keys of `config/experiments/*.yaml` and of `--set`.\n"
    sections: dict[str, type[configuration.Configuration]] = {
        f"Experiment\n\n{keys}": ExperimentConfiguration,
        "Node `simulator` (package `omni_sim`)\n\n": SimulatorConfiguration,
        "Node `linescan_odometry`\n\n": OdometryConfiguration,
        "Node `line_camera` (package `linescan_odometry`)\n\n": CameraConfiguration,
        "Node `brake_assist` (package `omni_brake_assist`)\n\n": BrakeAssistConfiguration,
        "Node `brake_adapter` (package `omni_vehicle`)\n\n": BrakeAdapterConfiguration,
        "Topics of `brake_adapter`\n\n": TopicsConfiguration,
        "Node `flow_sensor` (package `omni_vehicle`)\n\n": FlowChipConfiguration,
        "Readings of `flow_sensor`\n\n": FlowNodeConfiguration,
        "Node `twist_adapter` (package `omni_vehicle`)\n\n": TwistAdapterConfiguration,
    }
    head = "| parameter | default | unit | range | meaning |\n|---|---|---|---|---|"
    tables = (
        f"## {title}\n{head}\n" + "".join(f"{_row(*leaf)}\n" for leaf in _leaves(cls))
        for title, cls in sections.items()
    )
    return "\n".join((_HEAD, *tables))


def _leaves(cls: Any, prefix: str = "") -> Iterator[tuple[str, Any, ParameterInfo, Any]]:
    """Yield dotted key, type, description and default of each value of a configuration."""
    defaults = {field.name: field.default for field in dataclasses.fields(cls)}
    for name, kind, info in configuration.declared_parameters(cls):
        key = configuration.join_key(prefix, name)
        element = configuration.element_configuration(kind)
        if configuration.is_configuration(kind):
            yield from _leaves(kind, key)
        elif element is not None:
            yield from _leaves(element, configuration.join_key(key, "<name>"))
        else:
            yield key, kind, info, defaults[name]


def _row(key: str, kind: Any, info: ParameterInfo, default: Any) -> str:
    shown = "required" if default is dataclasses.MISSING else f"`{_in_yaml(default)}`"
    if info.choices is not None:
        permitted = ", ".join(f"`{choice}`" for choice in info.choices)
    else:
        permitted = info.bounds_in_words().removesuffix(f" {info.unit}")
    unit = info.unit or {bool: "", str: "", int: "1", float: "1"}.get(typing.cast(type, kind), "")
    return f"| `{key}` | {shown} | {unit} | {permitted} | {info.description} |"


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
