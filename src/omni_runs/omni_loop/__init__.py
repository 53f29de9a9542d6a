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
        f"{__name__}.yaml_files.check_complete": "omni_runs.experiment.check_complete",
        f"{__name__}.yaml_files.set_default": "omni_runs.experiment.set_default",
    },
)
