"""Table of hazards of docs/safety.md, generated from the marks of the tests.

A test is marked with ``safety(hazard, fault, caught_by, within=...)``. `within` is a limit on the
time [s], which the test gets by the fixture of this name; or a text that names the timeout of a
node, if this timeout is the limit.
``./omni exec python tests/safety_table.py`` writes the table into docs/safety.md. It shows, before
each limit, the measured time: the shortest limit that all cases of the test meet, in steps of 10 ms
or a thirtieth of the limit. ``./omni test --store-hazard-times`` measures these times.
"""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

WORKSPACE = Path(__file__).resolve().parents[1]
PAGE = WORKSPACE / "docs/safety.md"
_PLACE = re.compile(r"(?<=<!-- hazards -->\n).*?(?=<!-- /hazards -->)", re.DOTALL)
_HEAD = "| hazard | single fault | detected or limited by | within | test |"
TIMES: dict[str, float] = json.loads((WORKSPACE / "tests/hazard_times.json").read_text())
"""Measured times [s], keyed by fault."""


class Row(NamedTuple):
    """A row of the table: hazard, fault, detection, time and file of the test."""

    hazard: str
    fault: str
    caught_by: str
    within: str
    test: str


def rows() -> list[Row]:
    """Return the rows of all tests, grouped by hazard."""
    files = [*WORKSPACE.glob("src/*/test/**/test_*.py"), *WORKSPACE.glob("tests/test_*.py")]
    files.sort(key=lambda file: ("omni_brake_assist" not in file.parts, file))
    found = [row for file in files for row in _rows_of(file)]
    hazards = list(dict.fromkeys(row.hazard for row in found))
    return sorted(found, key=lambda row: hazards.index(row.hazard))


def table() -> str:
    """Return the table in Markdown."""
    lines, last = [_HEAD, "|---|---|---|---|---|"], ""
    for row in rows():
        hazard = "" if row.hazard == last else row.hazard
        last = row.hazard
        lines.append(f"| {hazard} | {row.fault} | {row.caught_by} | {row.within} | {row.test} |")
    return "\n".join(lines) + "\n"


def _rows_of(file: Path) -> Iterator[Row]:
    text = file.read_text(encoding="utf-8")
    if "mark.safety(" not in text:
        return
    tree = ast.parse(text)
    constants = {
        node.targets[0].id: node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)
    }
    for function in tree.body:
        if not isinstance(function, ast.FunctionDef):
            continue
        calls = [node for mark in function.decorator_list for node in ast.walk(mark)]
        for call in calls:
            if isinstance(call, ast.Call) and ast.unparse(call.func) == "pytest.mark.safety":
                hazard, fault, caught_by = (_text(word, constants) for word in call.args)
                within = _time(fault, ast.literal_eval(call.keywords[0].value))
                yield Row(hazard, fault, caught_by, within, f"`{file.stem}`")


def _text(word: ast.expr, constants: dict[str, ast.expr]) -> str:
    if isinstance(word, ast.Name):
        return _text(constants[word.id], constants)
    if isinstance(word, ast.BinOp):
        return _text(word.left, constants) + _text(word.right, constants)
    return str(ast.literal_eval(word))


def _time(fault: str, within: float | str) -> str:
    if isinstance(within, str):
        return within
    return f"{TIMES[fault]:g} ({within:g}) s" if within > 0.0 else "at once"


def main() -> None:
    """Write the table into the page."""
    PAGE.write_text(_PLACE.sub(table(), PAGE.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
