"""Import of the user's control law."""

from __future__ import annotations

from typing import TYPE_CHECKING

from omni_brake_assist.configuration import LAW_GROUP, LAWS, BrakeAssistConfiguration
from omni_core.geometry import PlatformGeometry
from omni_core.plugins import load_class, make_part

if TYPE_CHECKING:
    from omni_brake_assist.laws.law import Law


def own_law(configuration: BrakeAssistConfiguration, geometry: PlatformGeometry) -> Law | None:
    """Return the user's law that a configuration names; None for a built-in law.

    Args:
        configuration: configuration of the assistant.
        geometry: wheels of the vehicle.

    Raises:
        ConfigurationError: the law does not exist, or it cannot be imported or created.
    """
    if configuration.law in LAWS:
        return None
    cls = load_class("law", configuration.law, LAWS, LAW_GROUP, "step")
    centered = geometry.seen_from(geometry.center)
    made: Law = make_part("law", configuration.law, cls, configuration, centered)
    return made
