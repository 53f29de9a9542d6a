"""The actions of ``./omni bag``."""
