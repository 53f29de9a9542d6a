"""The studies, one module each; see `omni_studies.study`."""
