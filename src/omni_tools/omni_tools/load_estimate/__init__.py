"""Mass, center of gravity and wheel loads of a vehicle from its motion."""
