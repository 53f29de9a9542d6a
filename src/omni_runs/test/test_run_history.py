"""A history contains the given values, and two histories are equal only if all bits are equal."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_histories import first_difference

from omni_runs.history import RunHistory, continuous_yaw, quaternion_from_yaw

MakeHistory = Callable[..., RunHistory]


@given(yaw=st.floats(-50.0, 50.0))
def test_yaw_survives_the_quaternion_up_to_full_turns(yaw: float) -> None:
    back = float(continuous_yaw(np.array([quaternion_from_yaw(yaw)]))[0])
    assert -math.pi - 1e-9 <= back <= math.pi + 1e-9
    turns = (back - yaw) / math.tau
    assert turns == pytest.approx(round(turns), abs=1e-9)


def test_yaw_does_not_jump_over_many_turns() -> None:
    yaw = np.linspace(0.0, 40.0, 500)
    orientation = np.array([quaternion_from_yaw(float(value)) for value in yaw])
    np.testing.assert_allclose(continuous_yaw(orientation), yaw, atol=1e-12)


def test_yaw_does_not_depend_on_the_sign_of_the_quaternion() -> None:
    orientation = np.array([quaternion_from_yaw(yaw) for yaw in np.linspace(-1.0, 1.0, 9).tolist()])
    mixed = orientation * np.array([1, -1, 1, 1, -1, -1, 1, -1, -1])[:, np.newaxis]
    np.testing.assert_allclose(continuous_yaw(mixed), continuous_yaw(orientation), atol=1e-12)


def test_both_constructors_give_the_same_bits(make_history: MakeHistory) -> None:
    pose = make_history(turn=7.0, heading=0.3).pose
    run = make_history(pose=pose)
    again = RunHistory.from_quaternions(
        position=pose[:, :2],
        orientation=[quaternion_from_yaw(yaw) for yaw in pose[:, 2].tolist()],
        **{
            field.name: getattr(run, field.name)
            for field in dataclasses.fields(run)
            if field.name != "pose"
        },
    )
    assert first_difference(run, again) is None


@pytest.mark.parametrize(
    "name",
    ["twist", "wheel_angle", "wheel_speed", "brake_torque", "enable", "error", "estimate"],
)
def test_one_bit_is_a_difference_and_is_named(make_history: MakeHistory, name: str) -> None:
    run = make_history()
    values = getattr(run, name).copy()
    values[42, 1] = np.nextafter(values[42, 1], np.inf)
    other = make_history(**{name: values})
    words = first_difference(run, other)
    assert words is not None
    assert name in words
    assert "0.420 s" in words


def test_the_earliest_difference_is_reported_with_its_wheel(make_history: MakeHistory) -> None:
    run = make_history()
    speed, pose = run.wheel_speed.copy(), run.pose.copy()
    speed[10, 2] += 1.0
    pose[200, 0] += 1.0
    words = first_difference(run, make_history(wheel_speed=speed, pose=pose))
    assert words is not None
    assert "wheel_speed of rear_left at 0.100 s" in words


def test_histories_of_other_length_or_wheels_differ(make_history: MakeHistory) -> None:
    run = make_history()
    longer = first_difference(run, make_history(rest=0.6))
    assert longer is not None
    assert "stamps" in longer
    wheels = first_difference(run, make_history(wheel_names=("a", "b", "c", "d")))
    assert wheels is not None
    assert "wheels" in wheels


def test_missing_values_are_equal_and_differ_from_numbers(make_history: MakeHistory) -> None:
    error = make_history().error.copy()
    error[-1] = np.nan
    assert first_difference(make_history(error=error), make_history(error=error.copy())) is None
    assert first_difference(make_history(error=error), make_history()) is not None


def test_real_time_factor_is_no_part_of_the_state(make_history: MakeHistory) -> None:
    assert first_difference(make_history(real_time_factor=1.0), make_history()) is None


def test_unmeasured_estimates_become_nan_whatever_they_say(make_history: MakeHistory) -> None:
    run = make_history()
    estimate, variance = run.estimate.copy(), run.estimate_variance.copy()
    variance[3, 1] = 1e6
    variance[4, 0] = math.inf
    estimate[5, 2] = math.nan
    marked = make_history(estimate=estimate, estimate_variance=variance)
    assert np.flatnonzero(~marked.measured).tolist() == [3, 4, 5]
    assert np.all(np.isnan(marked.estimate[3:6]))
    assert np.all(np.isnan(marked.estimate_variance[3:6]))


def test_arrays_are_read_only_and_detached_from_their_source(make_history: MakeHistory) -> None:
    source = np.zeros((301, 4))
    run = make_history(enable=source)
    source[0, 0] = 5.0
    assert run.enable[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        run.enable[0, 0] = 1.0


def test_shapes_and_order_of_stamps_are_checked(make_history: MakeHistory) -> None:
    with pytest.raises(ValueError, match="wheel_speed has shape"):
        make_history(wheel_speed=np.zeros((301, 3)))
    stamps = make_history().stamp_ns.copy()
    stamps[7] = stamps[6]
    with pytest.raises(ValueError, match="must increase"):
        make_history(stamp_ns=stamps)


def test_velocity_in_the_world_does_not_turn_with_the_vehicle(make_history: MakeHistory) -> None:
    run = make_history(heading=0.7, turn=3.0)
    speed = np.hypot(run.twist[:, 0], run.twist[:, 1])
    expected = np.outer(speed, (math.cos(0.7), math.sin(0.7)))
    np.testing.assert_allclose(run.velocity_world, expected, atol=1e-12)
