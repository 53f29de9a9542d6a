"""The three-wheeled robot stops from a diagonal motion: Figures 33 to 35."""

from omni_analysis.braking.study import BrakingOptions, braking_study, from_above, over_time

Options = BrakingOptions

run = braking_study(
    "three_wheel_diagonal",
    {
        33: from_above("unassisted", "assisted"),
        34: over_time("unassisted"),
        35: over_time("assisted"),
    },
)
