"""Fixtures of this package."""

from made_recordings import bag

__all__ = ["bag"]
