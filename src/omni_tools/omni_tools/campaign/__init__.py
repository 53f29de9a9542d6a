"""Many runs of one kind on all cores, seed by seed."""
