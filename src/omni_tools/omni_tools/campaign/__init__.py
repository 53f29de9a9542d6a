"""Campaigns: many runs of one kind on all processor cores, one run for each seed."""
