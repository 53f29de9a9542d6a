"""Marks the fast tests: ``./omni test -m fast -n auto`` runs them, for while one works."""

from __future__ import annotations

from pathlib import Path

import pytest

SOURCES = Path(__file__).parent / "src"

DEAR = frozenset(
    """
    allocation bag_command bag_reader bag_tools camera_faults camera_optics closed_loop
    combined_slip design_sensors direct_search dissertation_claims experiment fail_safe
    fast_loop figures fit_tire flat_field footprint_integral ground_texture honesty
    identification lies limit line_camera line_studies mean_variance odometry_accuracy
    optical_study passive_losses placement_search pose process process_group replay robustness
    roller_vehicle rosbag2_writer sideslip_study spin_translate texture_studies tire_fit
    tire_models tire_study tires_of_vehicles uneven_ground wheel wheels
    """.split()  # noqa: SIM905
)
"""Files of tests below `src` that take more than two seconds of a quiet core each."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark all tests below `src` but those of dear files; the others start processes."""
    for item in items:
        if SOURCES in item.path.parents and item.path.stem.removeprefix("test_") not in DEAR:
            item.add_marker(pytest.mark.fast)
