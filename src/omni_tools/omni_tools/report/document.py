"""Self-contained HTML file of a report, and its plain values that strict JSON can represent.

Time series are base64 texts of little-endian 32-bit floats, one text per column, with NaN for a
missing value. Such texts are smaller than decimal numbers, and a browser reads them fast.

Slips and loads of the wheels are not recorded. Both are computed from the recorded true motion and
the vehicle's configuration. The slip in the report is the slip of the rim relative to the ground.
The simulator computes the slip of the contact patch, which differs for a few milliseconds after a
change of the brake because the tire is elastic. The loads are computed for flat ground.

The content security policy of the file forbids all requests and all scripts except its own, which
is identified by its hash. The content of recordings is a block of JSON, from which no text can
escape. The script inserts it as text, never as markup.
"""

import base64
import dataclasses
import hashlib
import itertools
import json
import math
import string
from collections.abc import Mapping, Sequence
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from omni_core.geometry import PlatformGeometry, turned
from omni_core.quantities import GRAVITY, FloatArray
from omni_runs.figures import style
from omni_runs.figures.scene import Scene
from omni_runs.figures.tables.comparison_table import in_readable_unit, metric_label, metric_number
from omni_runs.history import RunHistory
from omni_sim.masses import support_polygon
from omni_sim.vehicle.configuration import VehicleConfiguration
from omni_sim.vehicle.loads import load_plane, wheel_loads
from omni_tools.report import recording
from omni_tools.report.recording import ReportedRun, Series

_MOST_STAMPS = 12_000  # two minutes at 100 Hz; for longer runs, every n-th stamp is shown
_DEGREES = 180.0 / math.pi
# Nominal values of odometry and assistant, and the true values, which are the defaults.
_NOMINAL = {
    "odometry.sensors.": "sensors.",
    "odometry.flow_sensors.": "flow_sensors.",
    "brake_assist.wheels.": "vehicle.wheels.",
    "brake_assist.brake.": "vehicle.brake.",
}
_STANDSTILL = 0.05  # speed below which a wheel counts as at rest [m/s]


def report_document(title: str, runs: Sequence[recording.ReportedRun]) -> dict[str, Any]:
    """Return the content of a report as plain values.

    Args:
        title: title of the report.
        runs: runs in the order in which they are listed; at least one.
    """
    notes = ((run.name, one.note) for run in runs for one in run.metrics.values() if one.note)
    return {
        "title": title,
        "timeLabel": style.time_label(run.history for run in runs),
        "runs": [_run(run) for run in runs],
        "metrics": _metrics(runs),
        "metricNotes": [f"{name}: {note}" for name, note in dict.fromkeys(notes)],
        "configuration": _configuration(runs),
        "signals": {
            signal.name: [topic.name, signal.unit]
            for topic, signal in recording.SHOWN
            if any(signal.name in run.series for run in runs)
        },
    }


def _run(run: recording.ReportedRun) -> dict[str, Any]:
    """Return the data of one run that the page of the report draws."""
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
        scene = _scene(Scene.of(run.configuration), history.wheel_names)
        columns["slip"] = rim_slips(vehicle, history)
        if len(run.configuration.ground.elevation.table()):
            notes.append("the ground is not flat, so the loads do not follow from the motion")
        else:
            columns["load"] = flat_ground_loads(vehicle, history)
    return {
        "name": run.name,
        "wheels": [name.replace("_", " ") for name in history.wheel_names],
        "notes": notes,
        "columns": {name: _columns(values, stride) for name, values in columns.items()},
        "states": _states(history, stride),
        "forces": _sampled(history, run.forces),
        "series": {name: _sampled(history, series) for name, series in run.series.items()},
        "brakeStart": None if history.brake_start is None else history.brake_start // stride,
        "scene": scene,
    }


def _columns(values: ArrayLike, stride: int) -> list[str]:
    """Return each column of the values as a base64 text.

    Args:
        values: one or K columns, shape (T,) or (T, K).
        stride: the report contains every row whose index is a multiple of this number.
    """
    with np.errstate(over="ignore"):  # values too large for 32 bits become infinite
        rows = np.asarray(values, dtype="<f4")[::stride]
    columns = rows.reshape(len(rows), -1).T
    return [base64.b64encode(column.tobytes()).decode("ascii") for column in columns]


def _states(history: RunHistory, stride: int) -> list[tuple[int, str]]:
    """Return the changes of the assistant's state: row of the report, and new state."""
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
        "center": scene.chassis_center,
        "wheels": wheels,
        "load": scene.load,
        "loadArm": None if scene.load_arm is None else scene.load_arm.tolist(),
        "centerOfGravity": scene.center_of_gravity,
        "patches": [dataclasses.asdict(patch) for patch in scene.patches],
    }


def _metrics(runs: Sequence[recording.ReportedRun]) -> list[dict[str, Any]]:
    rows = []
    for quantity in dict.fromkeys(key for run in runs for key in run.metrics):
        unit, entries = in_readable_unit([run.metrics.get(quantity) for run in runs])
        values = [
            metric_number(entry.value, entry.unit) if entry and math.isfinite(entry.value) else None
            for entry in entries
        ]
        rows.append(
            {"label": metric_label(quantity), "unit": "" if unit == "1" else unit, "values": values}
        )
    return rows


def _configuration(runs: Sequence[recording.ReportedRun]) -> list[dict[str, Any]]:
    """Return a table of configuration values: a row for each key, with one value for each run.

    The value is None if the configuration of the run does not contain the key. Nominal values of
    odometry and assistant are left out if they are the true ones.
    """
    keys = dict.fromkeys(key for run in runs for key in run.values)
    rows = {key: [run.values.get(key) for run in runs] for key in keys}
    return [{"key": key, "values": row} for key, row in rows.items() if row != rows.get(_true(key))]


def _true(key: str) -> str:
    """Return the key of the true value to which a key of a nominal value belongs; empty if none."""
    for nominal, true in _NOMINAL.items():
        if key.startswith(nominal):
            return true + key.removeprefix(nominal)
    return ""


def rim_slips(vehicle: VehicleConfiguration, history: RunHistory) -> FloatArray:
    """Return the slip of each wheel along its active direction: 0 if it rolls, 1 if it is locked.

    The definition ``(n_w . v_i - omega R (n_w . u_i)) / max(|n_w . v_i|, |omega R (n_w . u_i)|)``
    extends Eqs. (20), (22) by a sign, for a wheel with the active direction ``n_w``, the velocity
    ``v_i`` of its center, the wheel speed ``omega``, the radius ``R`` and the rolling direction
    ``u_i``. The slip is relative to the larger speed, because Eq. (20) grows without bound for a
    locked wheel. If the slip is above 1, the rim turns backward; at rest the slip is NaN.

    Args:
        vehicle: vehicle with the wheels of the history, in any order.
        history: the run.

    Returns:
        Slips [1], from -2 to 2, shape (T, N), in the order of the history's wheels.
    """
    geometry = _geometry(vehicle, history)
    hub = history.twist @ np.column_stack((geometry.active, geometry.lever)).T  # Eq. (23)
    rim = history.wheel_speed * geometry.radius * np.sum(geometry.active * geometry.rolling, axis=1)
    larger = np.maximum(np.abs(hub), np.abs(rim))
    larger[larger < _STANDSTILL] = np.nan
    return np.asarray((hub - rim) / larger, dtype=np.float64)


def flat_ground_loads(vehicle: VehicleConfiguration, history: RunHistory) -> FloatArray:
    """Return the vertical wheel loads that balance weight and inertia in the recorded motion.

    The loads follow the acceleration of the center of gravity with a lag, the vehicle's load
    transfer time.

    Args:
        vehicle: vehicle with the wheels of the history, in any order.
        history: the run.

    Returns:
        Loads [N], shape (T, N), in the order of the history's wheels.
    """
    masses = vehicle.masses
    position = _geometry(vehicle, history).position - masses.center
    plane, hull = load_plane(position), support_polygon(position)
    acceleration = _acceleration(masses.center, history)
    loads = np.empty((len(history.stamp_ns), len(position)))
    lagged = np.zeros(2)
    periods = np.diff(history.time, prepend=history.time[0])
    for row, period in enumerate(periods.tolist()):
        share = period / (period + vehicle.load_transfer_time) if period > 0.0 else 0.0
        lagged += share * (acceleration[row] - lagged)
        z_x, z_y = (-masses.height / GRAVITY * lagged).tolist()
        wheel_loads(position, plane, hull, masses.mass * GRAVITY, z_x, z_y, loads[row])
    return loads


def _acceleration(point: FloatArray, history: RunHistory) -> FloatArray:
    """Return the acceleration of a point of the body, in the body frame [m/s^2], shape (T, 2)."""
    if len(history.stamp_ns) < 2:
        return np.zeros((len(history.stamp_ns), 2))
    yaw, yaw_rate = history.pose[:, 2], history.twist[:, 2:]
    velocity = turned(history.twist[:, :2] + yaw_rate * [-point[1], point[0]], yaw)
    a = np.diff(velocity, axis=0) / np.diff(history.time)[:, np.newaxis]
    return turned(np.vstack((a[:1], a)), -yaw)  # acceleration in the period before each stamp


def _geometry(vehicle: VehicleConfiguration, history: RunHistory) -> PlatformGeometry:
    return PlatformGeometry.from_wheels(
        {name: vehicle.wheels[name] for name in history.wheel_names}
    )


# Scripts in the order in which the browser reads them.
_SCRIPTS = ("data.js", "top_view.js", "plots.js", "tables.js", "player.js")


def report_page(
    title: str, runs: Sequence[ReportedRun], seen: Mapping[str, bytes] | None = None
) -> str:
    """Return the HTML text of a report on several runs.

    Args:
        title: title of the report.
        runs: runs in the order in which they are listed; at least one.
        seen: figures (PNG) of the camera lines, keyed by caption.

    Raises:
        ValueError: there is no run.
    """
    if not runs:
        raise ValueError("a report needs at least one run")
    style = _part("report.css")
    script = '"use strict";\n' + "".join(_part(name) for name in _SCRIPTS)
    pictures = {words: base64.b64encode(png).decode("ascii") for words, png in (seen or {}).items()}
    document = report_document(title, runs) | {"seen": pictures}
    data = json.dumps(document, allow_nan=False, separators=(",", ":"))
    parts = {
        "POLICY": (
            "default-src 'none'; base-uri 'none'; form-action 'none'; img-src data:; "
            f"style-src '{_hash(style)}'; script-src '{_hash(script)}'"
        ),
        "STYLE": style,
        "SCRIPT": script,
        # A browser ends the block at "</script", even inside a JSON text.
        "DATA": data.replace("<", "\\u003c"),
    }
    return string.Template(_part("report.html")).substitute(parts)


def _part(name: str) -> str:
    return (resources.files(__package__) / "page" / name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    digest = hashlib.sha256(text.encode("utf-8")).digest()
    return f"sha256-{base64.b64encode(digest).decode('ascii')}"
