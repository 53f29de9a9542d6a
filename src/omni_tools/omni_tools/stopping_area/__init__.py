"""Area that a vehicle needs to stop, for Nav2."""
