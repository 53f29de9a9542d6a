"""Many runs of one kind on all processor cores, one run per seed."""
