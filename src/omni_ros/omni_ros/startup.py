"""How a node waits for its subscribers before it publishes."""

import dataclasses

from omni_platform.configuration import Configuration, parameter


@dataclasses.dataclass(frozen=True, kw_only=True)
class StartupConfiguration(Configuration):
    """Parameters of the wait for subscribers, without which the first messages would be lost."""

    subscribers: int = parameter(0, minimum=0, maximum=100)
    """Subscriptions that each output must have before the node starts to work"""
    match_timeout: float = parameter(20.0, unit="s", above=0.0)
    """Longest wait for these subscriptions"""
