"""Campaigns of random stops: random draws, limits and figures."""
