"""Actions of ``./omni bag``."""
