"""Refusal of the files of a robot."""

from omni_core.configuration import ConfigurationError


def refused(problem: str) -> ConfigurationError:
    """Return the error of the option --from for a problem of its files, in a sentence."""
    return ConfigurationError("--from", problem)
