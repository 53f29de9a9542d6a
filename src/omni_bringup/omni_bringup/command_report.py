"""The result of a command, as `omni_bringup.cli` prints it for people and for programs."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

_LONGEST_LINE = 1000  # characters of a message, which may quote a damaged recording


@dataclass(frozen=True, kw_only=True)
class Report:
    """The result of a command.

    Attributes:
        name: name of the JSON document.
        metrics: entries of the document by ``quantity.case``.
        details: further entries of the document.
        text: lines, and tables of rich, that are printed without ``--json``; read only then.
        files: that were written, printed after the text.
        hints: lines printed last, such as how to use the files.
        summary: folder in which the document is kept as ``summary.json``.
        problems: sentences for standard error; if there are any, the exit code is 1.
        ok: whether the result is what the options ask for; otherwise the exit code is 1.
    """

    name: str
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
        """The results for programs."""
        return {"name": self.name, "metrics": dict(self.metrics), **self.details}


def entries(values: Mapping[str, tuple[float, str]]) -> dict[str, dict[str, Any]]:
    """Return metrics of the JSON document for (value, unit) by ``quantity.case``."""
    return {key: {"value": value, "unit": unit} for key, (value, unit) in values.items()}


def write_text(path: Path, text: str) -> Path:
    """Write a file, and its folder where it is missing; return its absolute path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path.resolve()


def printable(text: str) -> str:
    """Return text without control characters, shortened to fit a terminal."""
    if len(text) > _LONGEST_LINE:
        text = f"{text[:_LONGEST_LINE]}... ({len(text)} characters)"
    return "".join(
        letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in text
    )
