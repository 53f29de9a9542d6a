"""The comparison of two recordings accepts rounding, and nothing that a user would notice."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_recordings import JOINTS, STORE, header
from rosbags.rosbag2 import StoragePlugin, Writer

from omni_core.quantities import FloatArray
from omni_core.topics import DIAGNOSTICS, DIAGNOSTICS_TYPE, ENABLE, TWIST
from omni_recording.actions.compare import TopicComparison, compare_topics

PLANAR = np.ix_((0, 1, 5), (0, 1, 5))
LEVER = np.array([[1e-3, 0.0], [2e-4, 8e-3], [-5e-4, 3e-3]])  # of two velocities on the twist
COVARIANCE = LEVER @ LEVER.T + np.diag([1e-8, 1e-8, 1e-8])
MOTION = np.array([4.6, -0.04, 0.05])
WHEELS = ["wheel_1", "wheel_2"]


def compared(
    folder: Path, topic: str, kind: str, first: Sequence[Any], second: Sequence[Any], **how: float
) -> TopicComparison:
    """Compare the recordings of two sequences of messages, given without their headers."""
    for name, messages in (("first", first), ("second", second)):
        with Writer(folder / name, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            connection = writer.add_connection(topic, kind, typestore=STORE)
            for k, fields in enumerate(messages):
                message = STORE.types[kind](header(k * 10**7), *fields)
                writer.write(connection, k * 10**7, STORE.serialize_cdr(message, kind))
    return compare_topics(folder / "first", folder / "second", [topic], **how)[topic]


def twist(motion: FloatArray, covariance: FloatArray) -> tuple[Any]:
    vector, own = STORE.types["geometry_msgs/msg/Vector3"], STORE.types["geometry_msgs/msg/Twist"]
    whole = 1e3 * np.eye(6)
    whole[PLANAR] = covariance
    linear, angular = vector(motion[0], motion[1], 0.0), vector(0.0, 0.0, motion[2])
    stated = STORE.types["geometry_msgs/msg/TwistWithCovariance"]
    return (stated(own(linear, angular), whole.flatten()),)


def compared_twists(
    folder: Path, first: Sequence[Any], second: Sequence[Any], **how: float
) -> TopicComparison:
    return compared(folder, TWIST.path, TWIST.type, first, second, **how)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_the_tolerance_of_a_twist_does_not_depend_on_its_units(
    tmp_path: Path, scale: float
) -> None:
    own = twist(scale * MOTION, scale**2 * COVARIANCE)
    deviation = scale * np.sqrt(np.diag(COVARIANCE))
    shifted = twist(scale * MOTION + 0.005 * deviation, scale**2 * COVARIANCE)
    result = compared_twists(tmp_path, [own, own], [own, shifted])
    assert result.margin == pytest.approx(0.5)
    assert result.agrees
    assert (result.identical, result.outside) == (1, 0)


def test_single_precision_uses_a_tenth_of_the_tolerance_at_most(tmp_path: Path) -> None:
    first = [twist(k / 20 * MOTION, COVARIANCE) for k in range(20)]
    rounded = [
        twist((k / 20 * MOTION).astype(np.float32).astype(float), COVARIANCE.astype(np.float32))
        for k in range(20)
    ]
    assert 0.0 < compared_twists(tmp_path, first, rounded).margin <= 0.1


@pytest.mark.parametrize("entry", [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)])
@pytest.mark.parametrize(("share", "agrees"), [(0.005, True), (0.02, False)])
def test_every_entry_of_the_covariance_is_compared_on_its_scale(
    tmp_path: Path, entry: tuple[int, int], share: float, agrees: bool
) -> None:
    deviation = np.sqrt(np.diag(COVARIANCE))
    changed = COVARIANCE.copy()
    changed[entry] += share * deviation[entry[0]] * deviation[entry[1]]
    result = compared_twists(tmp_path, [twist(MOTION, COVARIANCE)], [twist(MOTION, changed)])
    assert result.agrees is agrees
    assert result.outside == (not agrees)
    assert result.worst.startswith("twist.covariance[")


def test_a_batch_that_only_one_recording_measures_is_outside(tmp_path: Path) -> None:
    measured, not_measured = twist(MOTION, COVARIANCE), twist(np.zeros(3), 1e3 * np.eye(3))
    for name, pair in (("a", (measured, not_measured)), ("b", (not_measured, measured))):
        first, second = ([measured, one, measured] for one in pair)
        result = compared_twists(tmp_path / name, first, second)
        assert not result.agrees
        assert (result.outside, result.identical) == (1, 2)


def test_a_given_tolerance_is_absolute(tmp_path: Path) -> None:
    first, second = [twist(MOTION, COVARIANCE)], [twist(MOTION + 1e-3, COVARIANCE)]
    assert compared_twists(tmp_path / "a", first, second, tolerance=2e-3).margin == pytest.approx(
        0.5
    )
    exact = compared_twists(tmp_path / "b", first, second, tolerance=0.0)
    assert exact.margin == np.inf
    assert not exact.agrees


# Columns: enables of one wheel in the first and in the second recording, switches that are one
# message earlier or later, messages that differ by more.
SWITCHES = {
    "equal": ("0011100", "0011100", 0, 0),
    "later": ("0011100", "0001100", 1, 0),
    "earlier": ("0011100", "0111100", 1, 0),
    "off": ("0011100", "0011110", 1, 0),
    "two": ("0011100", "0001110", 2, 0),
    "two_messages_later": ("0011100", "0000100", 0, 2),
    "no_switch": ("0011100", "0010100", 0, 1),
    "one_message": ("0001000", "0000000", 0, 1),
    "at_the_end": ("0000000", "0000001", 0, 1),
    "at_the_start": ("0111111", "1111111", 0, 1),
}


@pytest.mark.parametrize(("first", "second", "moved", "outside"), SWITCHES.values(), ids=SWITCHES)
def test_one_switch_may_be_a_message_earlier_or_later(
    tmp_path: Path, first: str, second: str, moved: int, outside: int
) -> None:
    nothing = np.zeros(0)
    runs = [
        [(WHEELS, nothing, nothing, np.array([float(enable), 1.0])) for enable in enables]
        for enables in (first, second)
    ]
    result = compared(tmp_path, ENABLE.path, JOINTS, *runs)
    assert (result.moved_switches, result.outside) == (moved, outside)
    assert result.agrees == (moved <= 1 and not outside)


@pytest.mark.parametrize(
    ("text", "agrees"),
    [
        ("0.52 of 10 lines match at wheel_1", True),
        ("5e-1 of 9 lines match at wheel_1", True),
        ("0.51 of 10 lines match at wheel_2", False),
        ("0.51 of 10 lines differ at wheel_1", False),
    ],
)
def test_texts_are_compared_without_their_numbers(tmp_path: Path, text: str, agrees: bool) -> None:
    status = STORE.types["diagnostic_msgs/msg/DiagnosticStatus"]
    first, second = (
        [([status(0, "front", words, "", [])],)]
        for words in ("0.51 of 10 lines match at wheel_1", text)
    )
    result = compared(tmp_path, DIAGNOSTICS.path, DIAGNOSTICS_TYPE, first, second)
    assert result.agrees is agrees
    assert result.different_texts == (not agrees)
