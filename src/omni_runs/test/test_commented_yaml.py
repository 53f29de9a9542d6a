"""Configuration files with comments contain the given values."""

from __future__ import annotations

import yaml

from omni_runs.yaml_files import commented_yaml

VALUES = {
    "body": {"mass": 300.0, "height": 1e-7},
    "wheels": {"left": {"x": 1e16, "name": "off"}, "right": {"x": -0.5, "name": "a: b # c"}},
    "points": [[1.0, 2.0], [3.0, 4.0]],
    "names": [f"a_name_of_some_length_{i}" for i in range(9)],
    "text": "[1, 2]",
    "on": True,
}


def test_values_survive_notes_and_heading() -> None:
    notes = {"body.height": "a guess", "wheels": "in order", "points": "corners"}
    text = commented_yaml(VALUES, "A vehicle\nof two wheels", notes)
    assert yaml.safe_load(text) == VALUES
    assert text.startswith("# A vehicle\n# of two wheels\nbody:\n  mass: 300.0\n")
    assert "names:\n  - a_name_of_some_length_0\n" in text
    assert "  height: 1.0e-07 # a guess\n" in text
    assert "wheels: # in order\n  left: {x: 1.0e+16, name: 'off'}\n" in text
