"""Conversion of a report to plain values that strict JSON can represent.

Time series are base64 texts of little-endian 32-bit floats, one text per column, with NaN for a
missing value. They are smaller than decimal numbers and fast to read in a browser.
"""

import base64
import dataclasses
import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from omni_figures import run_figures, style
from omni_figures.comparison_table import in_small_units, metric_label, metric_number
from omni_figures.scene import Scene
from omni_loop.history import RunHistory
from omni_platform.geometry import PlatformGeometry
from omni_tools.report import derived, recording
from omni_tools.report.series import Series

_MOST_STAMPS = 12_000  # two minutes at 100 Hz; of longer runs, every n-th stamp is shown
_DEGREES = 180.0 / math.pi


def report_document(title: str, runs: Sequence[recording.ReportedRun]) -> dict[str, Any]:
    """Return a report as plain values.

    Args:
        title: title of the report.
        runs: runs in the order in which they are listed; at least one.
    """
    return {
        "title": title,
        "timeLabel": style.time_label(run.history for run in runs),
        "runs": [_run(run) for run in runs],
        "metrics": _metrics(runs),
        "metricNotes": list(
            dict.fromkeys(
                f"{run.name}: {metric.note}"
                for run in runs
                for metric in run.metrics.values()
                if metric.note
            )
        ),
        "configuration": _configuration(runs),
    }


def _run(run: recording.ReportedRun) -> dict[str, Any]:
    history = run.history
    stride = math.ceil(len(history.stamp_ns) / _MOST_STAMPS)
    notes = list(run.notes)
    if stride > 1:
        notes.append(f"one of {stride} stamps is shown")
    if history.brake_start is None:
        notes.append("the brake pedal is never pressed, so time counts from the start")
    columns: dict[str, Any] = {
        "time": history.braking_time,
        "x": history.pose[:, 0],
        "y": history.pose[:, 1],
        "yaw": history.pose[:, 2],
        "heading": (history.pose[:, 2] - history.pose[history.brake_start or 0, 2]) * _DEGREES,
        "velocity": history.twist[:, :2],
        "yawRate": history.twist[:, 2],
        "velocityError": history.estimate[:, :2] - history.twist[:, :2],
        "yawRateError": history.estimate[:, 2] - history.twist[:, 2],
        "pedal": history.pedal,
        "enable": history.enable,
        "error": history.error,
    }
    scene = None
    if run.configuration is not None:
        vehicle = run.configuration.vehicle
        scene = _scene(run_figures.scene_of(run.configuration), history.wheel_names)
        columns["slip"] = derived.rim_slips(vehicle, history)
        if len(run.configuration.ground.elevation.table()):
            notes.append("the ground is not flat, so the loads do not follow from the motion")
        else:
            columns["load"] = derived.flat_ground_loads(vehicle, history)
    return {
        "name": run.name,
        "wheels": [name.replace("_", " ") for name in history.wheel_names],
        "notes": notes,
        "columns": {name: _columns(values, stride) for name, values in columns.items()},
        "states": _states(history, stride),
        "forces": _sampled(history, run.forces),
        "testRatios": _sampled(history, run.test_ratios),
        "brakeStart": None if history.brake_start is None else history.brake_start // stride,
        "scene": scene,
    }


def _columns(values: ArrayLike, stride: int) -> list[str]:
    """Return one text per column of values (T,) or (T, K)."""
    with np.errstate(over="ignore"):  # values too large for 32 bits become infinite
        rows = np.asarray(values, dtype="<f4")[::stride]
    columns = rows.reshape(len(rows), -1).T
    return [base64.b64encode(column.tobytes()).decode("ascii") for column in columns]


def _states(history: RunHistory, stride: int) -> list[tuple[int, str]]:
    """Return the changes of the assistant's state: row of the report and new state."""
    changes, row = [], 0
    for state, span in itertools.groupby(history.assist_state[::stride]):
        changes.append((row, state.replace("_", " ")))
        row += sum(1 for _ in span)
    return changes


def _sampled(history: RunHistory, series: Series | None) -> dict[str, Any] | None:
    if series is None:
        return None
    start_ns = history.stamp_ns[history.brake_start or 0]
    stride = max(math.ceil(len(series.stamp_ns) / _MOST_STAMPS), 1)
    return {
        "names": [name.replace("_", " ") for name in series.names],
        "time": _columns((series.stamp_ns - start_ns) * 1e-9, stride)[0],
        "values": _columns(series.values, stride),
    }


def _scene(scene: Scene, wheel_names: Sequence[str]) -> dict[str, Any]:
    scene = dataclasses.replace(scene, wheels={name: scene.wheels[name] for name in wheel_names})
    geometry = PlatformGeometry.from_wheels(scene.wheels)
    columns = {
        "position": geometry.position.tolist(),
        "radius": geometry.radius.tolist(),
        "active": geometry.active.tolist(),
        "outline": [outline.tolist() for outline in scene.wheel_outlines],
    }
    wheels = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    return {
        "length": scene.chassis_length,
        "width": scene.chassis_width,
        "wheels": wheels,
        "load": scene.load,
        "loadArm": None if scene.load_arm is None else scene.load_arm.tolist(),
        "centerOfGravity": scene.center_of_gravity,
        "patches": [dataclasses.asdict(patch) for patch in scene.patches],
    }


def _metrics(runs: Sequence[recording.ReportedRun]) -> list[dict[str, Any]]:
    rows = []
    for quantity in dict.fromkeys(key for run in runs for key in run.metrics):
        unit, entries = in_small_units([run.metrics.get(quantity) for run in runs])
        values = [
            metric_number(entry.value, entry.unit) if entry and math.isfinite(entry.value) else None
            for entry in entries
        ]
        rows.append(
            {"label": metric_label(quantity), "unit": "" if unit == "1" else unit, "values": values}
        )
    return rows


def _configuration(runs: Sequence[recording.ReportedRun]) -> list[dict[str, Any]]:
    """Return every key with its value in each run; None if a run does not have the key."""
    keys = dict.fromkeys(key for run in runs for key in run.values)
    return [{"key": key, "values": [run.values.get(key) for run in runs]} for key in keys]
