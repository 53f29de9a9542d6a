"""Claims about the metrics of a study, and the limits on these metrics.

``limits.yaml`` contains the limits, keyed by study and metric, and ``claims.yaml`` contains the
claims, keyed by study. A claim consists of a sentence, an expression and a comparison. In an
expression, ``quantity.case`` is a metric, ``quantity`` stands for the values of all cases, and
``of(quantity, "pattern")`` for the values of the cases whose names match the pattern. The functions
``min``, ``max``, ``mean``, ``abs`` and ``zip`` are available. A claim about metrics that a run does
not have, such as metrics of another ground, is omitted.
"""

import dataclasses
import functools
import math
import statistics
from collections.abc import Callable, Iterator, Mapping
from fnmatch import fnmatchcase
from importlib.resources import files
from typing import Any

import numpy as np
import yaml

from omni_runs.metrics import Metric, results_entry


@dataclasses.dataclass(frozen=True)
class Claim:
    """A claim about a study's metrics, and the value that was found.

    Attributes:
        sentence: text of the claim.
        found: value of the expression, with the limits that the comparison sets.
    """

    sentence: str
    found: Metric

    def __str__(self) -> str:
        found = self.found
        unit = "" if found.unit == "1" else f" {found.unit}"
        limits = [
            f"{words} {limit:g}"
            for words, limit in (("at least", found.at_least), ("at most", found.at_most))
            if limit is not None
        ]
        return f"{self.sentence}: {found.value:.3g}{unit}, {' and '.join(limits)}: {found.status}"

    def entry(self) -> dict[str, Any]:
        """Return the claim as an entry of the study's document."""
        return {"claim": self.sentence} | results_entry(self.found)


class _Cases(dict[str, float]):
    """Values of a quantity, keyed by case, for the formulas of claims.

    Each value is also available as an attribute. Iteration yields the values, not the keys.
    """

    def __getattr__(self, case: str) -> float:
        return self[case]

    def __iter__(self) -> Iterator[Any]:
        return iter(self.values())


def _of(cases: _Cases, pattern: str) -> list[float]:
    found = [value for case, value in cases.items() if fnmatchcase(case, pattern)]
    if not found:
        raise KeyError(pattern)
    return found


def _extreme(choose: Callable[[list[float]], float]) -> Callable[..., float]:
    """Return `numpy.min` or `numpy.max`, which return NaN if any value is NaN, for any values."""
    return lambda *values: choose(list(values[0] if len(values) == 1 else values))


_FUNCTIONS: dict[str, Any] = {
    "of": _of, "min": _extreme(np.min), "max": _extreme(np.max), "abs": abs,
    "mean": statistics.fmean, "zip": zip,
}  # fmt: skip


def limited(study: str, metrics: Mapping[str, Metric]) -> dict[str, Metric]:
    """Return the metrics of a study with their limits.

    Args:
        study: name of the study.
        metrics: metrics, keyed by ``<quantity>.<case>``.
    """
    limits = _read("limits.yaml").get(study, {})
    chosen: dict[str, Any] = {
        name: next((limits[pattern] for pattern in limits if fnmatchcase(name, pattern)), {})
        for name in metrics
    }
    return {name: dataclasses.replace(metric, **chosen[name]) for name, metric in metrics.items()}


@functools.cache
def _read(name: str) -> Any:
    return yaml.safe_load((files(__package__) / name).read_text(encoding="utf-8"))


def evaluate(study: str, metrics: Mapping[str, Metric]) -> tuple[Claim, ...]:
    """Evaluate the claims of a study with its metrics.

    Args:
        study: name of the study.
        metrics: metrics, keyed by ``<quantity>.<case>``.

    Returns:
        The claims for which all metrics exist.
    """
    names: dict[str, Any] = {}
    for name, metric in metrics.items():
        quantity, _, case = name.partition(".")
        names.setdefault(quantity, _Cases())[case] = metric.value
    claims = []
    for row in _read("claims.yaml").get(study, ()):
        try:
            value = float(eval(row["value"], {"__builtins__": {}, **_FUNCTIONS}, names))
        except (KeyError, NameError):
            continue
        except (ZeroDivisionError, ValueError):  # ValueError: such as max() of no values
            value = math.nan
        limits = {name: row[name] for name in ("at_least", "at_most") if name in row}
        found = Metric(value, row.get("unit", "1"), note=row.get("note", ""), **limits)
        claims.append(Claim(row["claim"], found))
    return tuple(claims)
