"""Braking with a front wheel already on ice, assisted and not: Figures 36 to 38."""

from omni_analysis.braking.study import BrakingOptions, braking_study, laid_over, over_time

Options = BrakingOptions

run = braking_study(
    "ice_patch",
    {
        36: laid_over("Braking on an ice patch, every 1 s and at rest", interval=1.0),
        37: over_time("unassisted"),
        38: over_time("assisted"),
    },
)
