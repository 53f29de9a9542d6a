"""Reading of a driver's demands (velocity and pedal) from a CSV table or a recording."""

from pathlib import Path
from typing import Any

import numpy as np

from omni_core import quantities, topics
from omni_core.configuration import ConfigurationError
from omni_core.files import read_columns
from omni_recording.error import BagError

_UNITS = {"time": "s", "forward": "m/s", "left": "m/s", "turn": "rad/s", "pedal": "1"}
COLUMNS = tuple(_UNITS)
# The second topic is used in old recordings.
_COMMANDS = (topics.COMMAND.path, topics.cmd_vel(stamped=True).path)
_PEDAL = topics.PEDAL.path


def read_demands(path: Path, key: str) -> dict[str, list[float]]:
    """Return the driver's demands as columns, keyed by the field names of `DemandConfiguration`.

    Args:
        path: a CSV file with the header ``time,forward,left,turn,pedal`` [s, m/s, m/s, rad/s, 1],
            or a rosbag2 folder or ``.mcap`` file that contains velocity command and pedal.
        key: configuration key, for error messages.

    Raises:
        ConfigurationError: the file cannot be read, or contains no demands.
    """
    try:
        if path.suffix.lower() == ".csv":
            table = np.array(read_columns(path, _UNITS))
        else:
            table = _read_recording(path)
        if not len(table):
            raise ValueError("it contains no rows")
    except (OSError, ValueError, BagError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise ConfigurationError(key, f"cannot read demands from {path}: {reason}") from None
    return {name: table[:, column].tolist() for column, name in enumerate(COLUMNS)}


def _read_recording(path: Path) -> quantities.FloatArray:
    from omni_recording import decode, folder

    found: dict[str, dict[int, Any]] = {topic: {} for topic in (*_COMMANDS, _PEDAL)}
    for recorded, message in decode.decoded_messages(folder.open_vehicle(path), found):
        stamp = decode.header_stamp_ns(message)
        if stamp is not None:
            found[recorded.channel.topic][stamp] = message
    commands = next((found[topic] for topic in _COMMANDS if found[topic]), {})
    stamps = sorted(commands.keys() & found[_PEDAL].keys())
    if not stamps:
        raise ValueError(f"it has no {_COMMANDS[0]} and {_PEDAL} with equal stamps")
    rows = []
    for stamp in stamps:
        twist, pedal = commands[stamp].twist, found[_PEDAL][stamp].position[0]
        motion = (twist.linear.x, twist.linear.y, twist.angular.z)
        rows.append(((stamp - stamps[0]) * 1e-9, *motion, pedal))
    return _without_repeats(np.array(rows, dtype=np.float64))


def _without_repeats(table: quantities.FloatArray) -> quantities.FloatArray:
    """Return a table (rows of time and demands) without rows whose demands repeat on both sides.

    Such a row has the same demands as the row before it and the row after it.
    """
    same = np.all(table[1:, 1:] == table[:-1, 1:], axis=1)
    kept = np.ones(len(table), bool)
    kept[1:-1] = ~(same[:-1] & same[1:])
    return table[kept]
