"""Options that studies share."""
