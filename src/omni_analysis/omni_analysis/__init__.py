"""Closed loop in one process, metrics and figures."""
