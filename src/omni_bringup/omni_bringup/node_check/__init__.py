"""Check whether a user's node keeps the contract of its topics."""
