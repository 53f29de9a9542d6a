"""Whether a node of anybody's keeps the contract of its topics."""
