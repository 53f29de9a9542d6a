"""An experiment and its closed loop in one process: run, history and metrics."""
