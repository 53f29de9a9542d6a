"""Old name of `omni_runs`."""

from omni_core.renamed import forward_imports

forward_imports(
    __name__,
    {
        __name__: "omni_runs",
        f"{__name__}.file_kinds": "omni_tools.vehicles.file_kinds",
        f"{__name__}.sweep": "omni_runs.sweep.sweep",
    },
)
