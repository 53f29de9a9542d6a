"""Fixtures of this package."""

from made_histories import make_history

__all__ = ["make_history"]
