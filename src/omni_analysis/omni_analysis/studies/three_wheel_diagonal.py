"""The three-wheeled robot stops from a diagonal motion: Figures 33 to 35."""

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
    times = [values[f"stopping_time.{variant}"] for variant in ("unassisted", "assisted")]
    return [
        claim(
            "It stops in less than a second",
            f"{times[0]:.2f} s unassisted, {times[1]:.2f} s assisted",
            holds=max(times) < 1.0,
        ),
        claim(
            "Assisted, it keeps its orientation and moves on at 45 deg",
            f"turned by {helped:.2f} against {free:.1f} deg, "
            f"{values['lateral_deviation.assisted']:.2f} against "
            f"{values['lateral_deviation.unassisted']:.2f} m aside of its line",
            holds=keeps_orientation(helped, free),
        ),
    ]


run = braking_study(
    "three_wheel_diagonal",
    {
        33: from_above("unassisted", "assisted"),
        34: over_time("unassisted"),
        35: over_time("assisted"),
    },
    _findings,
)
