"""Which setting of the brake assistant suits a vehicle."""
