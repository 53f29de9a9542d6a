"""Figures and tables of runs: style, scene from above, time series, comparison."""
