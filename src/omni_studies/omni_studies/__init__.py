"""Studies: computations that answer one question each, with figures, data and metrics."""
