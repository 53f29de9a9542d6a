"""Old name of `omni_runs.figures`."""

from omni_core.renamed import forward_imports

forward_imports(
    __name__,
    {
        __name__: "omni_runs.figures",
        f"{__name__}.snapshots": "omni_runs.figures.scene",
        f"{__name__}.sweep_figure": "omni_runs.sweep.figure",
        f"{__name__}.time_series.Limits": "omni_runs.figures.time_series.AxisLimits",
        f"{__name__}.tables.wrapped_table": "omni_core.commands.wrapped_table",
    },
)
