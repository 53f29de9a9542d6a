"""Table 2 of the dissertation: braking in a turn with each weighting of the 2013 law."""

from collections.abc import Mapping

from omni_runs.metrics import Metric

CASES = ("unassisted", "zero", "cosine", "k1", "k7")
"""Variants of the experiment ``turn_while_translate``, in the order of the table's columns."""

TWIST_ALONE = "brake_assist.fault_detection=false"
"""Override of the experiment for the dissertation's assistant, which uses only the twist."""

ORIENTATION_CHANGE = dict(zip(CASES, (83.8, 18.9, 63.2, 52.0, 26.3), strict=True))
"""Changes of orientation from the start of braking to the final position [deg], keyed by case."""

STOPPING_DISTANCE = dict(zip(CASES, (10.0, 12.2, 9.7, 9.3, 10.4), strict=True))
"""Stopping distances [m], keyed by case."""

REFERENCES: dict[str, float] = {
    **{f"orientation_change.{case}": value for case, value in ORIENTATION_CHANGE.items()},
    **{f"stopping_distance.{case}": value for case, value in STOPPING_DISTANCE.items()},
}
"""The ten numbers of Table 2, keyed by metric name."""


def tolerance(name: str) -> float:
    """Return the tolerance of a number, in the number's unit.

    For an orientation change, the tolerance is 5 % or 2 deg, whichever is larger. For a stopping
    distance it is 3 %.

    Args:
        name: one of `REFERENCES`.
    """
    reference = REFERENCES[name]
    if name.startswith("orientation_change"):
        return max(0.05 * reference, 2.0)
    return 0.03 * reference


def unit(name: str) -> str:
    """Return the unit of one of `REFERENCES`."""
    return "deg" if name.startswith("orientation_change") else "m"


def deviations(measured: Mapping[str, float]) -> dict[str, float]:
    """Return the deviation from each of the dissertation's numbers, in multiples of its tolerance.

    The deviations are keyed by metric name.

    Args:
        measured: simulated values of all metrics in `REFERENCES`, in their units.
    """
    return {
        name: (measured[name] - reference) / tolerance(name)
        for name, reference in REFERENCES.items()
    }


def metrics(measured: Mapping[str, float]) -> dict[str, Metric]:
    """Return the ten numbers of Table 2 and their deviations from the dissertation's numbers.

    Args:
        measured: simulated values of all metrics in `REFERENCES`, in their units.

    Returns:
        Every number with its reference value, and the ends of its tolerance as limits. The
        magnitude of its deviation is ``<quantity>_deviation.<case>``, limited by the tolerance.
    """
    result: dict[str, Metric] = {}
    for name, reference in REFERENCES.items():
        quantity, _, case = name.partition(".")
        value, limit, deviation = measured[name], tolerance(name), abs(measured[name] - reference)
        result[name] = Metric(value, unit(name), reference, reference + limit, reference - limit)
        result[f"{quantity}_deviation.{case}"] = Metric(deviation, unit(name), at_most=limit)
    return result
