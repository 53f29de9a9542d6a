"""Old name of `omni_runs`."""

from omni_core.renamed import forward_imports

forward_imports(
    __name__,
    {
        __name__: "omni_runs",
        f"{__name__}.experiment.FEEDBACKS": "omni_runs.experiment_configuration.FEEDBACKS",
        f"{__name__}.file_kinds": "omni_tools.vehicles.file_kinds",
        f"{__name__}.recorded_run.stops_of": "omni_runs.stops.stops_of",
        f"{__name__}.sweep": "omni_runs.sweep.sweep",
    },
)
