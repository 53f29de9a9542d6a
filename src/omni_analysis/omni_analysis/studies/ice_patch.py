"""Braking with a front wheel already on ice, assisted and not: Figures 36 to 38."""

from omni_analysis.braking.study import (
    BrakingOptions,
    Values,
    braking_study,
    from_above,
    keeps_orientation,
    over_time,
)
from omni_analysis.studies import claim

Options = BrakingOptions


def _findings(values: Values) -> list[str]:
    free, helped = values["orientation_change.unassisted"], values["orientation_change.assisted"]
    farther = values["stopping_distance.assisted"] - values["stopping_distance.unassisted"]
    return [
        claim(
            "Assisted, orientation and direction do not change much",
            f"{helped:.1f} against {free:.1f} deg, "
            f"{values['lateral_deviation.assisted']:.2f} m aside",
            holds=keeps_orientation(helped, free),
        ),
        claim(
            "It stops farther away, by almost half of the platform's width",
            f"{farther:.2f} m; how much is a matter of the patch, which is assumed",
            holds=farther > 0.0,
        ),
    ]


run = braking_study(
    "ice_patch",
    {
        36: from_above(),
        37: over_time("unassisted"),
        38: over_time("assisted"),
    },
    _findings,
)
