"""Commissioning of a vehicle: mistakes in its description, found from a few slow motions."""
