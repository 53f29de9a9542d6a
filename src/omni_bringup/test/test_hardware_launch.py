"""The launch file for a real vehicle checks its arguments; the test needs no `launch`."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest

from omni_core.configuration import ConfigurationError

FILE = Path(__file__).parents[1] / "launch" / "hardware.launch.py"


def test_a_misspelled_argument_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("", ".actions", ".event_handlers"):
        monkeypatch.setitem(sys.modules, f"launch{name}", MagicMock())
    for name in ("launch_ros", "launch_ros.actions"):
        monkeypatch.setitem(sys.modules, name, MagicMock())
    monkeypatch.setattr(sys, "argv", ["ros2", "launch", "omni_bringup", FILE.name])
    runpy.run_path(str(FILE))["generate_launch_description"]()
    start = sys.modules["launch.actions"].OpaqueFunction.call_args.kwargs["function"]
    with pytest.raises(ConfigurationError, match="did you mean 'namespace'"):
        start(SimpleNamespace(argv=["namespac:=robot1"], launch_configurations={}))
