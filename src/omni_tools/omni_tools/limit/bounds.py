"""Old name of `omni_runs.limit.bounds`."""

from omni_core.renamed import forward_imports

forward_imports(__name__, {__name__: "omni_runs.limit.bounds"})
