"""Vehicles before they drive: estimated, judged, drawn."""
