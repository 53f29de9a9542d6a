"""Driving by hand: page, server and driver node."""
