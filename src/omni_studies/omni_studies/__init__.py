"""Studies: computations that answer one question with figures, data and metrics."""
