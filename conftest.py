"""Marks the fast tests, for while one works (``./omni test -m fast -n auto``), and orders all.

Tests of the safety case carry ``safety(hazard, fault, caught_by, within=...)``, from which
``tests/safety_table.py`` makes the table of docs/safety.md.
"""

from __future__ import annotations

import math
from pathlib import Path

import pytest

SOURCES = Path(__file__).parent / "src"

DEAR = frozenset(
    """
    allocation bag_command bag_reader bag_tools camera_faults camera_optics closed_loop
    combined_slip design_sensors direct_search dissertation_claims experiment fail_safe
    fast_loop figures fit_tire flat_field footprint_integral ground_texture integrity
    identification lies limit line_camera line_studies mean_variance odometry_accuracy
    optical_study passive_losses placement_search pose process process_group replay robustness
    roller_vehicle rosbag2_writer sideslip_study spin_translate texture_studies tire_fit
    tire_models tire_study tires_of_vehicles uneven_ground wheel wheels
    """.split()  # noqa: SIM905
)
"""Files of tests below `src` that take more than two seconds of a quiet core each."""


FIRST = (
    *("test_tutorial", "test_straight_line", "test_command_line", "test_studies", "test_extending"),
    *("test_killed_nodes", "test_replay", "test_launcher", "test_real_time", "test_drive"),
)
"""Files of tests that take longest: were one begun last, all cores but one would wait for it."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark all tests below `src` but those of dear files; put those that start processes first."""
    rank = {name: place for place, name in enumerate(FIRST)}
    items.sort(key=lambda item: (rank.get(item.path.stem, len(rank)), SOURCES in item.path.parents))
    for item in items:
        if SOURCES in item.path.parents and item.path.stem.removeprefix("test_") not in DEAR:
            item.add_marker(pytest.mark.fast)


@pytest.fixture
def within(request: pytest.FixtureRequest) -> float:
    """The time within which the safety case says that what a test shows happens [s]."""
    mark = request.node.get_closest_marker("safety")
    return float(mark.kwargs["within"]) if mark else math.inf
