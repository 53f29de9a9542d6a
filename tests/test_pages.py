"""Every command on a page is accepted, and is run unless a reason is listed."""

from __future__ import annotations

import re
import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from omni_process import WORKSPACE

from omni_bringup.cli import main, parse_command_line

PAGES = (
    "README.md",
    "CONTRIBUTING.md",
    "docs/*.md",
    "docs/tutorials/*.md",
    "src/**/README.md",
    "bags/README.md",
    "benchmarks/README.md",
)
_MEANT = {"COMMAND": "run", "N": "1"}  # values that a reader inserts
_OF_THE_LAUNCHER = ("exec", "install", "test")
_ELSEWHERE = {  # pages that a test follows word for word
    "docs/tutorials/your_vehicle.md": "test_tutorial.py",
    "docs/real_vehicle.md": "test_real_vehicle.py",
    "src/omni_tools/omni_tools/robot_files/README.md": "test_real_vehicle.py",
    "docs/extending.md": "test_extending.py",
}
_NOT_HERE = {  # beginning of a command, and why it is not run here
    "run": "a stop over the graph: test_straight_line.py, test_command_line.py, test_sweep.py",
    "drive": "waits for a person: test_drive_page.py has one",
    "new-vehicle": "test_tutorial.py",
    "ros-params": "test_real_vehicle.py",
    "replay": "the reader's recordings: test_replay.py",
    "lines": "the reader's files: test_lines_command.py makes some",
    "calibrate-sensors": "the reader's drives: test_lines_command.py makes some",
    "fit-tire": "the reader's measurements: test_fit_tire_command.py makes some",
    "estimate-load": "the reader's recordings: test_estimate_load_command.py makes some",
    "fit-brakes": "the reader's recordings: test_fit_brakes_command.py has ours",
    "design-sensors": "half a minute: test_design_sensors.py",
    "nav2-polygons": "ten thousand stops: test_stopping_area.py has fewer",
    "study laws": "minutes: test_laws.py has the parts",
    "study robustness": "minutes: test_robustness.py has fewer runs",
    "study tuning": "minutes: test_tuning.py has fewer situations",
    "study table2": "test_studies.py",
    "study steered_cameras": "test_steered_cameras.py",
    "study rates": "test_rates.py has fewer stops",
    "study feedback": "minutes: test_feedback.py has fewer stops",
    "check-vehicle": "the reader's recording: test_mistakes.py drives some vehicles",
    "study straight_line --law": "a law of the reader's: test_extending.py writes one",
}


def commands() -> Iterator[tuple[str, str]]:
    """Yield page and command line, without ``./omni``, of each command in a block of a page."""
    for pattern in PAGES:
        for page in sorted(WORKSPACE.glob(pattern)):
            text = page.read_text(encoding="utf-8")
            for block in re.findall(r"^ *```(?:sh|bash)\n(.*?)^ *```", text, re.S | re.M):
                for line in block.replace("\\\n", " ").splitlines():
                    found = re.match(r" *\./omni ([^#|&]+)", line)
                    if found:
                        name = page.relative_to(WORKSPACE).as_posix()
                        yield name, " ".join(found[1].split())


ALL = [row for row in dict.fromkeys(commands()) if row[1].split()[0] not in _OF_THE_LAUNCHER]
QUICK = list(
    dict.fromkeys(
        line
        for page, line in ALL
        if page not in _ELSEWHERE and not line.startswith(tuple(_NOT_HERE))
    )
)


@pytest.mark.parametrize(("page", "line"), ALL, ids=[f"{page}: {line}" for page, line in ALL])
def test_a_command_of_a_page_is_understood(page: str, line: str) -> None:
    program, _, _ = parse_command_line(shlex.split(line))
    assert program.split()[1:] == line.split()[: len(program.split()) - 1], page


def inline_commands() -> Iterator[tuple[str, str]]:
    """Yield page and command line, without ``./omni``, of each command in running text."""
    for pattern in PAGES:
        for page in sorted(WORKSPACE.glob(pattern)):
            text = re.sub(r"^ *```.*?^ *```", "", page.read_text("utf-8"), flags=re.S | re.M)
            for words in re.findall(r"`\./omni ([^`]+)`", text):
                yield page.relative_to(WORKSPACE).as_posix(), " ".join(words.split())


def misunderstood(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Return why a command line is rejected; empty if it is accepted or asks for help."""
    try:
        parse_command_line(words)
    except SystemExit as ended:
        said = capsys.readouterr().err
        return said if ended.code else ""
    return ""


def test_a_program_of_a_page_is_in_the_environment() -> None:
    programs = {line.split()[1] for _, line in commands() if line.startswith("exec ")}
    assert {name for name in programs if shutil.which(name) is None} == set()


def test_a_command_in_running_text_is_understood(capsys: pytest.CaptureFixture[str]) -> None:
    lines = list(dict.fromkeys(inline_commands()))
    assert len(lines) > 100
    for page, line in lines:
        words = [_MEANT.get(word, word) for word in shlex.split(line)]
        if words[0] not in _OF_THE_LAUNCHER and "study NAME" not in line:  # one still to be written
            why = misunderstood(words, capsys)
            # A text may name a command without what it is given.
            assert not why or "the following arguments are required: " in why, (page, line)


@pytest.mark.parametrize("line", QUICK)
def test_a_quick_command_of_a_page_does_what_it_says(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # From a workspace of its own, which results may be written to.
    for folder in ("bags", "config"):
        (tmp_path / folder).symlink_to(WORKSPACE / folder)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("OMNI_WORKSPACE", str(tmp_path))
    with pytest.raises(SystemExit) as ended:
        main(shlex.split(line))
    said = capsys.readouterr()
    assert ended.value.code == 0, said.err
    assert said.out


def test_why_a_command_is_not_run_is_still_so() -> None:
    lines = [line for _, line in ALL]
    assert all(any(line.startswith(known) for line in lines) for known in _NOT_HERE)
    tests = {path.name for path in WORKSPACE.glob("src/*/test/**/test_*.py")}
    tests |= {path.name for path in WORKSPACE.glob("tests/test_*.py")}
    named = " ".join((*_ELSEWHERE.values(), *_NOT_HERE.values()))
    assert set(re.findall(r"test_\w+\.py", named)) <= tests
    assert set(_ELSEWHERE) <= {page for page, _ in ALL}
