"""Driving a simulated vehicle by hand: page in the browser, server of the page, driver node."""
