"""Check whether a user's node meets the contract of its topics."""
