"""Experiments and their closed loop in one process: configuration, run, history and metrics."""
