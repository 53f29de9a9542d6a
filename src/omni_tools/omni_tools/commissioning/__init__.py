"""Commissioning of a vehicle: errors in its description, found from a few slow motions."""
