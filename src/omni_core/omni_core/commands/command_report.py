"""Result of a command, which `omni_bringup.cli` prints as text or as JSON."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omni_core.configuration import ConfigurationError
from omni_core.files import replaced

if TYPE_CHECKING:
    from omni_core.commands.wrapped_table import WrappedTable


@dataclass(frozen=True, kw_only=True)
class Report:
    """Result of a command: metrics, printed text, files and problems.

    Attributes:
        name: name of the JSON document; if empty, the document has the name of the command.
        metrics: metrics in the JSON document, keyed by ``quantity.case``.
        details: further entries of the JSON document, keyed by name.
        text: lines and `rich` tables that are printed without ``--json``; with ``--json``, this
            iterator is not used.
        files: paths of the written files, printed after the text.
        hints: lines printed at the end, such as how to use the files.
        summary: folder in which the document is stored as ``summary.json``; None not to store it.
        problems: sentences for standard error; if there are any, the exit code is 1.
        ok: False if a check failed or a limit in the options is not met; the exit code is then 1.
    """

    name: str = ""
    metrics: Mapping[str, Any] = field(default_factory=dict)
    details: Mapping[str, Any] = field(default_factory=dict)
    text: Iterable[Any] = ()
    files: Sequence[Path] = ()
    hints: Sequence[str] = ()
    summary: Path | None = None
    problems: Sequence[str] = ()
    ok: bool = True

    @property
    def document(self) -> dict[str, Any]:
        """Content of the JSON document that the command prints or stores."""
        return {"name": self.name, "metrics": dict(self.metrics), **self.details}


def entries(values: Mapping[str, tuple[float, str]]) -> dict[str, dict[str, Any]]:
    """Return metrics of the JSON document from pairs (value, unit), keyed by ``quantity.case``."""
    return {key: {"value": value, "unit": unit} for key, (value, unit) in values.items()}


def entries_by_case(
    cases: Mapping[str, Mapping[str, tuple[float, str]]],
) -> dict[str, dict[str, Any]]:
    """Return metrics of the JSON document from pairs (value, unit), keyed by case and quantity."""
    return entries(
        {f"{key}.{case}": value for case, row in cases.items() for key, value in row.items()}
    )


def in_words(row: Mapping[str, tuple[float, str]]) -> str:
    """Return pairs (value, unit), keyed by quantity, as one line of text."""
    return ", ".join(
        f"{key.replace('_', ' ')} {value:.4g} {'' if unit == '1' else unit}".rstrip()
        for key, (value, unit) in row.items()
    )


def estimate(value: float, unit: str, error: float, *, bounded: bool = False) -> dict[str, Any]:
    """Return the metric of an estimated quantity.

    Args:
        value: estimate, in `unit`.
        unit: unit of the quantity.
        error: standard error of the estimate, in `unit`; NaN if unknown.
        bounded: whether the estimate is at a bound of the search, which a note then states.
    """
    known = None if math.isnan(error) else float(error)
    entry = {"value": float(value), "unit": unit, "standard_error": known}
    return entry | ({"note": "on its bound"} if bounded else {})


def estimate_table(metrics: Mapping[str, Mapping[str, Any]]) -> WrappedTable:
    """Return a table of estimates with standard errors and, if known, the configured values."""
    from omni_core.commands.wrapped_table import WrappedTable
    from omni_core.quantities import plain

    shown = {key: entry for key, entry in metrics.items() if "standard_error" in entry}
    cases = {key.partition(".")[2] for key in shown}
    quantities, errors = [], []
    for key, entry in shown.items():
        quantity, _, case = key.partition(".")
        of_case = "" if case == "all" or len(cases) == 1 else f", {case}"
        quantities.append(quantity.replace("_", " ") + of_case)
        error = entry["standard_error"]
        parts = ("" if error is None else plain(error, 2), entry.get("note", ""))
        errors.append(", ".join(filter(None, parts)))
    names = {"quantity": quantities, "unit": [entry["unit"] for entry in shown.values()]}
    values = [f"{entry['value']:.6g}" for entry in shown.values()]
    numbers = {"value": values, "standard error": errors}
    if any("described" in entry for entry in shown.values()):
        described = (entry.get("described") for entry in shown.values())
        numbers["described"] = ["" if one is None else f"{one:.5g}" for one in described]
    return WrappedTable(names, numbers)


def make_folder(folder: Path) -> Path:
    """Create a folder before its results are computed, and return its absolute path.

    Raises:
        ConfigurationError: the folder cannot be created, or is not writable.
    """
    action = "make"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        action = "write to"
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise ConfigurationError("--out", f"cannot {action} {folder}: {error.strerror}") from None
    return folder.resolve()


def write_text(path: Path, text: str) -> Path:
    """Write a text file atomically, create its folder if missing, and return its absolute path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        with replaced(path) as file:
            file.write_text(text, encoding="utf-8")
    except OSError as error:  # a full disk raises an error that does not name the file
        raise OSError(error.errno, error.strerror, str(path)) from None
    return path.resolve()


def printable(text: str, longest: int = 1000) -> str:
    """Return a text from a recording, shortened and without control characters."""
    if len(text) > longest:
        text = f"{text[:longest]}... ({len(text)} characters)"
    return "".join(
        letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in text
    )
