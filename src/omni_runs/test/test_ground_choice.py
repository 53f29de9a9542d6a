"""A ground is given by a name or a picture with its scale; otherwise the reason is reported."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from omni_core.configuration import ConfigurationError
from omni_runs.experiment import ExperimentLibrary
from omni_runs.ground_choice import ground_overrides, prepare_grounds
from omni_sim.texture.cache import TextureCache

LIBRARY = ExperimentLibrary(Path(__file__).resolve().parents[3] / "config")
CACHE = TextureCache(Path("/nowhere"))  # pictures are not cached


@pytest.fixture
def scan(tmp_path: Path) -> Path:
    """A scan whose name contains characters with a meaning in YAML."""
    path = tmp_path / "our: yard, #1.png"
    gray = np.random.default_rng(1).integers(0, 256, (600, 800), np.uint8)
    Image.fromarray(gray).save(path)
    return path


@pytest.mark.parametrize("ground", ["wood", "walking_tile", "plastic", "metal", "dry_earth"])
def test_a_named_ground_replaces_that_of_the_experiment(ground: str) -> None:
    overrides = ground_overrides(ground, None)
    texture = LIBRARY.load("straight_line", "assisted", overrides).ground.texture
    assert (texture.kind, texture.extent[0]) == (ground, 18912)


def test_dots_per_inch_apply_to_named_grounds() -> None:
    texture = LIBRARY.load("straight_line", "assisted", ground_overrides("stone", 1200.0))
    assert texture.ground.texture.extent[0] == 9472
    assert ground_overrides(None, None) == ()


def test_a_picture_becomes_the_ground(scan: Path) -> None:
    configuration = LIBRARY.load("straight_line", "assisted", ground_overrides(str(scan), 200.0))
    texture = configuration.ground.texture
    assert (texture.kind, texture.picture, texture.dpi) == ("picture", str(scan), 200.0)
    prepare_grounds([configuration, configuration], CACHE)


def test_a_picture_needs_a_scale(scan: Path) -> None:
    with pytest.raises(ConfigurationError, match="--dpi"):
        ground_overrides(str(scan), None)


def test_a_picture_smaller_than_what_a_camera_sees_is_refused(scan: Path) -> None:
    configuration = LIBRARY.load("straight_line", "assisted", ground_overrides(str(scan), 600.0))
    with pytest.raises(ConfigurationError, match=r"use a picture of at least 0\.05 m"):
        prepare_grounds([configuration], CACHE)


def test_what_is_no_picture_is_refused_before_anything_starts(tmp_path: Path) -> None:
    broken = tmp_path / "photo.jpg"
    broken.write_bytes(b"no picture")
    configuration = LIBRARY.load("straight_line", "assisted", ground_overrides(str(broken), 300.0))
    with pytest.raises(ConfigurationError, match="cannot read") as error:
        prepare_grounds([configuration], CACHE)
    assert error.value.key == "ground.texture.picture"


def test_a_ground_is_drawn_before_anything_waits_for_it(tmp_path: Path) -> None:
    cache = TextureCache(tmp_path)
    configuration = LIBRARY.load("straight_line", "assisted", ground_overrides("wood", 100.0))
    prepare_grounds([configuration], cache)
    assert cache.path(configuration.ground.texture).is_file()
