"""Table of the metrics of an experiment's variants, for a terminal."""

import dataclasses
import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rich import box
from rich.console import Console, ConsoleOptions
from rich.table import Table
from rich.text import Text

from omni_core.commands.wrapped_table import name_parts, wrapped_name
from omni_runs.figures.units import readable_unit
from omni_runs.metrics import Metric

_DECIMALS = {"m": 2, "mm": 0, "deg": 1, "s": 2, "rad/s": 3, "m/s": 3}
_BEFORE_REFERENCE = re.compile(r" (?=\()")  # where a cell may wrap


@dataclasses.dataclass(frozen=True)
class ComparisonTable:
    """Table with a row for each quantity and a column for each variant.

    If the terminal is too narrow for all variants, the remaining variants follow in further tables.
    Names may wrap, but numbers never do. A value that misses its limit is marked with ``!``. The
    value in the dissertation, if there is one, follows in parentheses. A dash stands for an
    undefined quantity; the reason is below the table.

    Attributes:
        metrics_by_variant: results of `run_metrics`, keyed by variant, in the order of the columns.
        title: title above the table; None for no title.
    """

    metrics_by_variant: Mapping[str, Mapping[str, Metric]]
    title: str | None = None

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Table | Text]:
        """Yield tables that fit the width of the console, and the notes below them."""
        title = self.title
        left = list(self.metrics_by_variant)
        while left:
            # Use the widest table that fits: first with all variants, then with headings that wrap
            # between the parts of names, then with fewer variants.
            for count, wraps in itertools.product(range(len(left), 0, -1), (False, True)):
                shown = {name: self.metrics_by_variant[name] for name in left[:count]}
                table = _table(shown, title, wraps)
                needed = console.measure(table, options=options.update(width=10_000))
                if needed.minimum <= options.max_width:
                    break
            yield table
            title = None
            left = left[count:]
        notes = (
            f"{variant}: {metric.note}"
            for variant, metrics in self.metrics_by_variant.items()
            for metric in metrics.values()
            if metric.note
        )
        yield from map(Text, dict.fromkeys(notes))


def _table(
    metrics_by_variant: Mapping[str, Mapping[str, Metric]], title: str | None, wraps: bool
) -> Table:
    """Return a table in which only the first column may become narrower.

    Args:
        metrics_by_variant: results, keyed by variant, in the order of the columns.
        title: title above the table; None for no title.
        wraps: whether headings wrap between the parts of names.
    """
    table = Table(
        title=None if title is None else Text(title),
        title_justify="left",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
    )
    variants = metrics_by_variant.values()
    # Each quantity appears once, in the order in which the variants list it.
    rows = {
        metric_label(quantity): in_readable_unit([metrics.get(quantity) for metrics in variants])
        for quantity in dict.fromkeys(key for metrics in variants for key in metrics)
    }
    words = [word for label in rows for word in label.split()]
    table.add_column("", min_width=max(map(len, words), default=1))
    table.add_column("unit", no_wrap=True)
    for place, variant in enumerate(metrics_by_variant):
        cells = [_cell(entries[place]).plain for _, entries in rows.values()]
        parts = [part for cell in cells for part in _BEFORE_REFERENCE.split(cell)]
        whole = (*name_parts(variant), *parts) if wraps else (variant, *cells)
        width = max(map(len, whole), default=1)
        heading = wrapped_name(variant, width)
        table.add_column(heading, justify="right", overflow="fold", width=width)
    for label, (unit, entries) in rows.items():
        table.add_row(Text(label), "" if unit == "1" else unit, *map(_cell, entries))
    return table


def in_readable_unit(entries: Sequence[Metric | None]) -> tuple[str, list[Metric | None]]:
    """Return the unit and the entries of a row, in a unit that suits their magnitude.

    Args:
        entries: entry of each column; None if the variant of the column does not have the quantity.
    """
    known = [entry for entry in entries if entry is not None]
    given = known[0].unit if known else ""
    unit, factor = readable_unit(given, (entry.value for entry in known))
    return unit, [None if entry is None else _times(entry, factor, unit) for entry in entries]


def _times(metric: Metric, factor: float, unit: str) -> Metric:
    scaled: dict[str, Any] = {
        name: None if number is None else number * factor
        for name in ("value", "reference", "at_most", "at_least")
        for number in (getattr(metric, name),)
    }
    return dataclasses.replace(metric, unit=unit, **scaled)


def metric_label(quantity: str) -> str:
    """Return the label of a quantity, indented if it belongs to a single wheel."""
    name, _, wheel = quantity.partition(".")
    label = (
        f"  {wheel}" if wheel else re.sub("_(rmse|ate|rpe)$", lambda found: found[0].upper(), name)
    )
    return label.replace("_", " ")


def _cell(metric: Metric | None) -> Text:
    missed = metric is not None and metric.status == "missed"
    return Text(metric_cell(metric), style="bold red" if missed else "")


def metric_cell(metric: Metric | None) -> str:
    """Return the text of a cell: the value, ``!`` if it misses its limit, and the reference."""
    if metric is None or not math.isfinite(metric.value):
        return "-"
    words = metric_number(metric.value, metric.unit)
    if metric.status == "missed":
        words += " !"
    if metric.reference is not None:
        words += f" ({metric_number(metric.reference, metric.unit)})"
    return words


def metric_number(value: float, unit: str) -> str:
    """Format a value with a number of digits that suits its unit."""
    if unit == "1" and float(value).is_integer():
        return f"{value:.0f}"
    return f"{value:.{_DECIMALS.get(unit, 2)}f}"
