"""Driving by hand: the page, its server and the driver's seat."""
