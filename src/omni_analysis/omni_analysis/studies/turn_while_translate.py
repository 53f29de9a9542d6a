"""Braking out of a turn-while-translate maneuver under every weighting: Figures 43 to 48."""

from omni_analysis.braking.study import (
    BrakingOptions,
    Values,
    braking_study,
    from_above,
    over_time,
)
from omni_analysis.studies import claim

Options = BrakingOptions


def _findings(values: Values) -> list[str]:
    laws = ("zero", "cosine", "k1", "k7")
    turned = {law: values[f"orientation_change.{law}"] for law in ("unassisted", *laws)}
    length = {law: values[f"stopping_distance.{law}"] for law in ("unassisted", *laws)}
    shorter = [law for law in laws if length[law] < length["unassisted"]]
    return [
        claim(
            "Every weighting turns the vehicle less than no assistant",
            ", ".join(f"{law} {angle:.1f} deg" for law, angle in turned.items()),
            holds=max(turned[law] for law in laws) < turned["unassisted"],
        ),
        claim(
            "Cosine and k = 1 stop shorter than no assistant",
            ", ".join(f"{law} {distance:.2f} m" for law, distance in length.items())
            + "; on the fitted patch, not on even friction",
            holds=shorter == ["cosine", "k1"],
        ),
    ]


run = braking_study(
    "turn_while_translate",
    {
        43: from_above("unassisted", "zero", "cosine"),
        44: over_time("unassisted", errors=False),
        45: over_time("zero"),
        46: over_time("cosine"),
        47: from_above("cosine", "k1", "k7"),
        48: over_time("k1"),
    },
    _findings,
)
