"""The metrics of an experiment's variants side by side, for a terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping

from rich import box
from rich.table import Table
from rich.text import Text

from omni_analysis.metrics import Metric

_DECIMALS = {"m": 2, "deg": 1, "s": 2, "rad/s": 3, "m/s": 3}


def comparison_table(
    metrics_by_variant: Mapping[str, Mapping[str, Metric]], *, title: str | None = None
) -> Table:
    """Return a table with a row per quantity and a column per variant.

    A value past its limit is marked with ``!``; the dissertation's figure follows in brackets.
    A quantity without meaning is a dash, and the lines below the table say why.

    Args:
        metrics_by_variant: what `run_metrics` returned, in the order of the columns.
        title: printed above the table.
    """
    table = Table(
        title=None if title is None else Text(title),
        title_justify="left",
        caption_justify="left",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
    )
    table.add_column("", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    for variant in metrics_by_variant:
        table.add_column(Text(variant), justify="right", overflow="fold")
    for quantity in _quantities(metrics_by_variant):
        entries = [metrics.get(quantity) for metrics in metrics_by_variant.values()]
        unit = next((entry.unit for entry in entries if entry is not None), "")
        name, _, wheel = quantity.partition(".")
        label = f"  {wheel}" if wheel else name.replace("_rmse", "_RMSE")
        table.add_row(
            Text(label.replace("_", " ")), "" if unit == "1" else unit, *map(_cell, entries)
        )
    notes = {
        f"{variant}: {metric.note}": None
        for variant, metrics in metrics_by_variant.items()
        for metric in metrics.values()
        if metric.note
    }
    if notes:
        table.caption = Text("\n".join(notes))
    return table


def _quantities(metrics_by_variant: Mapping[str, Mapping[str, Metric]]) -> list[str]:
    """Return every quantity once, in the order of the variants that have it."""
    return list(dict.fromkeys(key for metrics in metrics_by_variant.values() for key in metrics))


def _cell(metric: Metric | None) -> Text:
    if metric is None or not math.isfinite(metric.value):
        return Text("-")
    words = _number(metric.value, metric.unit)
    exceeded = metric.limit is not None and metric.value > metric.limit
    if exceeded:
        words += " !"
    if metric.reference is not None:
        words += f" ({_number(metric.reference, metric.unit)})"
    return Text(words, style="bold red" if exceeded else "")


def _number(value: float, unit: str) -> str:
    if unit == "1" and float(value).is_integer():
        return f"{value:.0f}"
    return f"{value:.{_DECIMALS.get(unit, 2)}f}"
