"""Monitors that ask for all brakes, or keep a law from going by what cannot be. One module each."""
