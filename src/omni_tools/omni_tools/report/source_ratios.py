"""Test ratios of the measurement sources, as the assistant's fault detection published them."""

import dataclasses
from pathlib import Path

import numpy as np

from omni_loop.recorded_run import read_streams
from omni_platform.quantities import FloatArray, IntArray
from omni_platform.topics import TEST_RATIOS
from omni_recording.error import BagError
from omni_recording.folder import open_vehicle


@dataclasses.dataclass(frozen=True)
class SourceRatios:
    """Test ratios of S sources, M of each.

    Attributes:
        names: names of the sources.
        stamp_ns: stamps [ns], increasing, shape (M,).
        ratio: squared innovation over its gate [1], NaN without an innovation, shape (M, S).
    """

    names: tuple[str, ...]
    stamp_ns: IntArray
    ratio: FloatArray


def read_test_ratios(bag_folder: Path | str) -> SourceRatios | None:
    """Return the test ratios of a recording, None if there are none.

    Raises:
        BagError: the recording cannot be read, or its messages name different sources.
    """
    bag = open_vehicle(bag_folder)
    stream = read_streams(bag, {TEST_RATIOS.name: TEST_RATIOS.type}, ()).get(TEST_RATIOS.name)
    if stream is None:
        return None
    names = tuple(stream.messages[0].name)
    for message in stream.messages:
        if tuple(message.name) != names or len(message.position) != len(names):
            raise BagError(bag.path, f"{TEST_RATIOS.path} names different sources")
    rows = np.array([message.position for message in stream.messages], dtype=np.float64)
    return SourceRatios(names, stream.stamp_ns, rows)
