"""What ``./omni bag`` does with a recording."""
