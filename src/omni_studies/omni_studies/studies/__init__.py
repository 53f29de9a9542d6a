"""The studies, a module each, found by their names; see `omni_studies.study`."""
