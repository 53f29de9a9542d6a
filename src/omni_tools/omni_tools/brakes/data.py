"""Recorded stops as data for the fit of the brakes: motion, wheel speeds and commands."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from omni_core import brakes, configuration, quantities, topics
from omni_recording.folder import open_vehicle
from omni_runs.recorded_run import Stream, measured_twist, ordered, read_streams, values_of

_WHEELS, _PEDAL, _ENABLE = topics.WHEEL_STATES.name, topics.PEDAL.name, topics.ENABLE.name


class BrakeDataError(configuration.InputError):
    """The recordings do not determine torque and timing of the brakes; the message states why."""


class BrakeData(NamedTuple):
    """One recorded stop with K samples, C changes of the command and N wheels.

    Attributes:
        time: time of the samples [s], increasing, shape (K,).
        twist: twist of `base_link` in the body frame [m/s, m/s, rad/s], shape (K, 3).
        wheel_speed: rotational speed of each wheel [rad/s], shape (K, N).
        command_time: start of each command [s], increasing, shape (C,).
        command: commanded share of the maximum torque of each brake [1], shape (C, N).
    """

    time: quantities.FloatArray
    twist: quantities.FloatArray
    wheel_speed: quantities.FloatArray
    command_time: quantities.FloatArray
    command: quantities.FloatArray


def read_brake_data(
    folder: Path, wheel_names: tuple[str, ...], brake: brakes.BrakeConfiguration, twist_topic: str
) -> BrakeData:
    """Return the data of a recorded stop.

    Args:
        folder: rosbag2 folder or single MCAP file with `wheel_states`, `brake/pedal` and a twist;
            it also contains `brake/enable`, unless the stop was made without an assistant.
        wheel_names: wheel names of the vehicle, in the order of the columns.
        brake: configuration of the brakes, which gives the resolution of the valves.
        twist_topic: a key of `topics.WITH_TWIST`.

    Raises:
        BagError: the recording cannot be read or lacks a topic.
        BrakeDataError: recording and vehicle have different wheels, the twist was never measured,
            or a demand is not finite.
    """
    required = (topics.WHEEL_STATES, topics.PEDAL, topics.WITH_TWIST[twist_topic])
    streams = read_streams(open_vehicle(folder), (*required, topics.ENABLE), required)
    wheels, twists, pedal = (streams[name] for name in (_WHEELS, twist_topic, _PEDAL))
    start_ns = int(wheels.stamp_ns[0])

    def seconds(stream: Stream) -> quantities.FloatArray:
        return 1e-9 * (stream.stamp_ns - start_ns).astype(np.float64)

    def by_wheel(stream: Stream, field: str) -> quantities.FloatArray:
        try:
            return np.array([ordered(message, field, wheel_names) for message in stream.messages])
        except ValueError as error:
            raise BrakeDataError(f"{error}; is it a recording of this vehicle?") from None

    moved = np.array([measured_twist(message.twist) for message in twists.messages])
    measured = np.all(np.isfinite(moved), axis=1)
    if not np.any(measured):
        raise BrakeDataError(f"{folder}: no message on {twist_topic} has a measured twist")
    time = seconds(wheels)
    inside = (time >= seconds(twists)[measured][0]) & (time <= seconds(twists)[measured][-1])
    time = time[inside]
    twist = [np.interp(time, seconds(twists)[measured], column) for column in moved[measured].T]
    demands = [values_of(m, "pedal", ()) for m in pedal.messages]
    command_time, command = seconds(pedal), np.array(demands)
    if not np.all(np.isfinite(command)):
        raise BrakeDataError(f"{folder}: a message on {_PEDAL} has no finite demand")
    shares = np.ones((len(command), len(wheel_names)))
    if _ENABLE in streams:
        enable = by_wheel(streams[_ENABLE], "effort")
        if brake.is_switched:
            enable = (enable >= 0.5).astype(np.float64)
        # An enable is combined with the pedal of the same stamp. Before the first enable, all
        # brakes are on.
        row = np.searchsorted(seconds(streams[_ENABLE]), command_time, side="right") - 1
        shares[row >= 0] = np.clip(enable[row[row >= 0]], 0.0, 1.0)
    return BrakeData(
        time=time,
        twist=np.column_stack(twist),
        wheel_speed=by_wheel(wheels, "velocity")[inside],
        command_time=command_time,
        command=np.clip(command, 0.0, 1.0)[:, np.newaxis] * shares,
    )
