"""Laws by name: the built-in laws, and classes given as ``module:Class``."""

from omni_brake_assist.configuration import LAW_GROUP, LAWS, BrakeAssistConfiguration
from omni_brake_assist.laws.law import Law
from omni_platform.geometry import PlatformGeometry
from omni_platform.plugins import load_class, make_part


def own_law(configuration: BrakeAssistConfiguration, geometry: PlatformGeometry) -> Law | None:
    """Create the user's law that a configuration names; None for a built-in law.

    Args:
        configuration: configuration of the assistant.
        geometry: wheels of the vehicle.

    Raises:
        ConfigurationError: there is no such law, or it cannot be imported or created.
    """
    if configuration.law in LAWS:
        return None
    cls = load_class("law", configuration.law, LAWS, LAW_GROUP, "step")
    made: Law = make_part("law", configuration.law, cls, configuration, geometry)
    return made
