"""Insertion of measured numbers into the pages, from the documents of the commands.

A page names the template of a table, and contains the filled template below this name::

    <!-- numbers: ice_patch -->
    | rotation [deg] | 2.4 |
    <!-- /numbers -->

``docs/templates/ice_patch.txt`` contains the template. Its name begins with the study; a full stop
and a word follow if the pages have several tables of one study::

    | rotation [deg] | {orientation_change.assisted:.1f} |

``{metric.case:mark}`` inserts a mark if the metric is not zero, and nothing if it is zero.
``{study:metric.case:.1f}`` refers to a metric of another study, and ``run_EXPERIMENT`` to a run
over the ROS graph. ``{table.row_column}`` refers to a cell of ``table.csv`` in the folder of the
study. ``row`` is the first cell of the row and ``column`` the head of the column; in both, ``_``
replaces all characters except letters and digits.

``docs/numbers.json`` stores the numbers that the templates use. This program reads them from the
given ``summary.json`` files and fills the pages. The results of a study that was run with other
options need a different study name, which is put before the file as NAME::

    ./omni exec python -m omni_studies.page_numbers results/*/summary.json NAME=other/summary.json

If the new results lack a number that a page shows, for example because an optional package is not
installed, the page then shows a dash, and the exit code is 1.

With ``--check``, the program changes nothing. Its exit code is 1 if a page differs from
``docs/numbers.json``, or if a stored number differs from the number in a given file by more than 2
% and by more than one unit of the last printed digit.
"""

import argparse
import contextlib
import csv
import json
import math
import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

Numbers = Mapping[str, Mapping[str, float | None]]
"""Values of metrics, keyed by study and metric name."""

PICTURE_NUMBERS = "omni numbers"
"""Key of the text in a PNG file that contains the numbers of the picture as a JSON document."""

_PLACE = re.compile(r"\{(?:(\w+):)?([a-z]\w*\.[\w.]+?)(?::([^{}]*))?\}")
_BLOCK = re.compile(r"(<!-- numbers: ((\w+)[.\w]*) -->\n).*?(<!-- /numbers -->)", re.DOTALL)
_PAGES = ("README.md", "docs/*.md", "benchmarks/*.md", "src/**/README.md")


class Place(NamedTuple):
    """Reference in a page's template to a metric of a study.

    Attributes:
        study: the study of the metric.
        metric: name of the metric.
        form: format specification of the number, as for `format`.
    """

    study: str
    metric: str
    form: str


def _word(text: str) -> str:
    return re.sub(r"\W+", "_", text).strip("_")


def filled(template: str, study: str, numbers: Numbers) -> str:
    """Return a template filled with numbers; an unknown number becomes a dash.

    Args:
        template: template with references as in the module's docstring.
        study: study of the references that do not name a study.
        numbers: numbers to insert.
    """

    def number(found: re.Match[str]) -> str:
        value = numbers.get(found[1] or study, {}).get(found[2])
        if found[3] == "mark":
            return " ✗" if value else ""
        return "-" if value is None else format(value, found[3] or "")

    return _PLACE.sub(number, template)


def shown(workspace: Path) -> Iterator[tuple[Path, Place]]:
    """Yield page and place of every number that the pages show.

    The last page is the file ``docs/dissertation.yaml``, in which all references name their study.
    """
    templates = [
        (page, block[3], _template(workspace, block[2]))
        for pattern in _PAGES
        for page in sorted(workspace.glob(pattern))
        for block in _BLOCK.finditer(page.read_text(encoding="utf-8"))
    ]
    table = workspace / "docs/dissertation.yaml"
    for page, study, template in (*templates, (table, "", table.read_text(encoding="utf-8"))):
        for found in _PLACE.finditer(template):
            yield page, Place(found[1] or study, found[2], found[3] or "")


def used_numbers(workspace: Path, study: str) -> set[str]:
    """Return the names of the metrics of a study that the pages show."""
    return {place.metric for _, place in shown(workspace) if place.study == study}


def _template(workspace: Path, name: str) -> str:
    return (workspace / f"docs/templates/{name}.txt").read_text(encoding="utf-8")


def stored(workspace: Path) -> dict[str, dict[str, float | None]]:
    """Return the numbers stored in ``docs/numbers.json``, keyed by study and metric."""
    text = (workspace / "docs/numbers.json").read_text(encoding="utf-8")
    numbers: dict[str, dict[str, float | None]] = json.loads(text)
    return numbers


def measured(arguments: list[str], used: Iterable[Place]) -> dict[str, dict[str, float | None]]:
    """Return the numbers in the given documents, keyed by study and metric.

    A run over the ROS graph counts as the study ``run_NAME``.

    Args:
        arguments: paths of ``summary.json`` files, or ``NAME=path``.
        used: references that are to be filled; they determine which tables are read.

    Raises:
        SystemExit: if two documents have different values of one metric of one study.
    """
    found: dict[str, dict[str, float | None]] = {}
    for argument in arguments:
        own, _, path = argument.rpartition("=")
        file = Path(path)
        document: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        beside_recording = (file.parent / "metadata.yaml").exists()
        name = own or ("run_" if beside_recording else "") + document["name"]
        numbers = found.setdefault(name, {})
        values = {key: metric["value"] for key, metric in document["metrics"].items()}
        if twice := {key for key in numbers.keys() & values if numbers[key] != values[key]}:
            raise SystemExit(
                f"{file}: an earlier file has another value of {name} {min(twice)}; "
                f"name one of the two studies, as in OTHER_NAME={file}"
            )
        numbers |= values
        others = {place.metric for place in used if place.study == name} - set(numbers)
        for table in {file.parent / f"{metric.partition('.')[0]}.csv" for metric in others}:
            if table.exists():
                numbers |= dict(_cells(table))
    return found


def _cells(table: Path) -> Iterator[tuple[str, float]]:
    """Yield name and value of each number in a table."""
    with table.open(encoding="utf-8", newline="") as lines:
        for row in csv.DictReader(lines):
            (_, first), *rest = row.items()
            for head, cell in rest:
                with contextlib.suppress(ValueError):
                    yield f"{table.stem}.{_word(first)}_{_word(head)}", float(cell)


def outdated(place: Place, old: float | None, new: float | None, tolerance: float = 0.02) -> bool:
    """Return whether a stored number differs too much from a measured one.

    The difference must exceed both a relative tolerance and one unit of the last printed digit. The
    result is also true if only one of the numbers exists.
    """
    if old is None or new is None:
        return old is not new
    printed = re.search(r"\.(\d+)([f%])", place.form)
    step = 10.0 ** -(int(printed[1]) + 2 * (printed[2] == "%")) if printed else 0.0
    return not math.isclose(old, new, rel_tol=tolerance, abs_tol=step * 1.0001)


def main() -> int:
    """Fill the pages, or check that they are up to date; report lost and outdated numbers."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("files", nargs="*", help="summary.json files of commands")
    parser.add_argument("--check", action="store_true", help="only report outdated numbers")
    options = parser.parse_args()
    workspace = Path(os.environ.get("OMNI_WORKSPACE", "."))
    used = list(shown(workspace))
    numbers, new = stored(workspace), measured(options.files, [place for _, place in used])
    kept: dict[str, dict[str, float | None]] = {}
    problems = []
    for page, place in used:
        old = numbers.get(place.study, {}).get(place.metric)
        value = new[place.study].get(place.metric) if place.study in new else old
        if (options.check or value is None) and outdated(place, old, value):
            problems.append(f"{page.name}: {place.study} {place.metric}: {old}, now {value}")
        kept.setdefault(place.study, {})[place.metric] = value
    if not options.check:
        text = json.dumps(kept, indent=1, sort_keys=True) + "\n"
        (workspace / "docs/numbers.json").write_text(text, encoding="utf-8")
        numbers = kept
    for page in dict.fromkeys(page for page, _ in used if page.suffix == ".md"):
        text = page.read_text(encoding="utf-8")
        full = _BLOCK.sub(
            lambda b: b[1] + filled(_template(workspace, b[2]), b[3], numbers) + b[4], text
        )
        if not options.check:
            page.write_text(full, encoding="utf-8")
        elif full != text:
            problems.append(f"{page.name}: its numbers are not those of docs/numbers.json")
    for problem in problems:
        print(problem, file=sys.stderr)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
