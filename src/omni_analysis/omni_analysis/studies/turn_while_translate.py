"""Braking out of a turn-while-translate maneuver under every weighting: Figures 43 to 48."""

from omni_analysis.braking.study import BrakingOptions, braking_study, from_above, over_time

Options = BrakingOptions

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
)
