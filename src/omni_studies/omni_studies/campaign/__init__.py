"""Campaigns of random stops: draws, limits and figures."""
