"""Who drives: a script, or a person."""
