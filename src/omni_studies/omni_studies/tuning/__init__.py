"""Recommended settings of the brake assistant for a vehicle."""
