"""User classes are found by name; other names are rejected with a remedy."""

from __future__ import annotations

import importlib.metadata
from pathlib import Path

import pytest

from omni_core.configuration import ConfigurationError
from omni_core.plugins import check_name, load_class

GROUP = "parts.of.a.test"
BUILT_IN = ("first", "second")


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A module in the working directory, which is not on Python's path."""
    (tmp_path / "parts_in_a_folder.py").write_text(
        "class Part:\n    def act(self): return 1\n\nclass Other: ...\n"
    )
    (tmp_path / "broken_part.py").write_text("raise OSError('no such device')\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", ["/nowhere"])
    return "parts_in_a_folder"


def test_a_class_is_found_in_the_working_directory(module: str) -> None:
    part = load_class("part", f"{module}:Part", BUILT_IN, GROUP, "act")
    assert part().act() == 1


def test_an_installed_package_offers_names(module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def offered(*, group: str) -> list[importlib.metadata.EntryPoint]:
        assert group == GROUP
        return [importlib.metadata.EntryPoint("third", f"{module}:Part", group)]

    monkeypatch.setattr(importlib.metadata, "entry_points", offered)
    check_name("part", "third", BUILT_IN, GROUP)
    assert load_class("part", "third", BUILT_IN, GROUP).__name__ == "Part"
    with pytest.raises(ConfigurationError, match="did you mean 'third'") as refused:
        check_name("part", "thirt", BUILT_IN, GROUP)
    assert "known: first, second, third" in str(refused.value)


@pytest.mark.usefixtures("module")
@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("frist", "did you mean 'first'"),
        ("", "known: first, second"),
        ("no_such_part:Part", "working directory or on PYTHONPATH"),
        ("broken_part:Part", "OSError: no such device"),
        ("parts_in_a_folder:Prat", "it has Part, Other"),
        ("parts_in_a_folder:", "it has Part, Other"),
        ("math:pi", "it has none"),
        (":Part", "ValueError"),
        ("parts_in_a_folder:Other", "has no method 'act'"),
    ],
)
def test_what_is_no_part_is_refused(name: str, problem: str) -> None:
    with pytest.raises(ConfigurationError, match="part") as refused:
        load_class("part", name, BUILT_IN, GROUP, "act")
    assert problem in str(refused.value)
