"""Driving by hand: the page, its server and the node of the driver."""
