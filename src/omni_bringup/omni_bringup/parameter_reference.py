"""The reference of every parameter, made from the declarations.

``python -m omni_bringup.parameter_reference > docs/parameters.md`` writes it anew.
"""

import dataclasses
import sys
import typing
from collections.abc import Iterator
from typing import Any

from linescan_odometry.camera.configuration import CameraConfiguration
from linescan_odometry.odometry import OdometryConfiguration
from omni_brake_assist.brake_assist import BrakeAssistConfiguration
from omni_loop.experiment import ExperimentConfiguration
from omni_platform import configuration
from omni_sim.configuration import SimulatorConfiguration
from omni_vehicle.brake_adapter import BrakeAdapterConfiguration
from omni_vehicle.brake_adapter_node import TopicsConfiguration
from omni_vehicle.flow_chips import FlowChipConfiguration

_HEAD = """\
# Parameters

This page lists every parameter with its default, unit, range and meaning.
Use it to look up the keys of experiments and of the nodes' ROS parameters.
It is generated from the code by `python -m omni_bringup.parameter_reference`; do not edit it.
`<name>` stands for the name of a wheel, sensor or patch. As ROS parameters the names themselves
are listed in `wheels.names`, `sensors.names` and so on.
"""


def reference() -> str:
    """Return the reference as Markdown."""
    parts = [_HEAD]
    sections: list[tuple[str, str, type[configuration.Configuration]]] = [
        (
            "Experiment",
            "The keys of `config/experiments/*.yaml` and of `--set`.",
            ExperimentConfiguration,
        ),
        ("Node `simulator` (package `omni_sim`)", "", SimulatorConfiguration),
        ("Node `linescan_odometry`", "", OdometryConfiguration),
        ("Node `line_camera` (package `linescan_odometry`)", "", CameraConfiguration),
        ("Node `brake_assist` (package `omni_brake_assist`)", "", BrakeAssistConfiguration),
        ("Node `brake_adapter` (package `omni_vehicle`)", "", BrakeAdapterConfiguration),
        ("Topics of `brake_adapter`", "", TopicsConfiguration),
        ("Node `flow_sensor` (package `omni_vehicle`)", "", FlowChipConfiguration),
    ]
    for title, words, cls in sections:
        rows = "\n".join(_rows(cls, ""))
        table = f"| parameter | default | unit | range | meaning |\n|---|---|---|---|---|\n{rows}\n"
        parts.append("\n".join(part for part in (f"## {title}\n", words and words + "\n", table)))
    return "\n".join(parts)


def _rows(cls: type[configuration.Configuration], prefix: str) -> Iterator[str]:
    defaults = {field.name: field for field in dataclasses.fields(cls)}
    for name, kind, info in configuration.declared_parameters(cls):
        key = configuration.join_key(prefix, name)
        element = configuration.element_configuration(kind)
        if configuration.is_configuration(kind):
            yield from _rows(kind, key)
        elif element is not None:
            yield from _rows(element, configuration.join_key(key, "<name>"))
        else:
            yield _row(key, kind, info, defaults[name].default)


def _row(key: str, kind: Any, info: configuration.ParameterInfo, default: Any) -> str:
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
