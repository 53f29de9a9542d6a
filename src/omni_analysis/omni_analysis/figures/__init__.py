"""What figures of runs share, and the two that every run leaves."""
