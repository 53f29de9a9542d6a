"""Old name of `omni_core`."""

from omni_core.renamed import forward_imports

forward_imports(
    __name__,
    {
        __name__: "omni_core",
        f"{__name__}.command_options": "omni_core.commands.command_options",
        f"{__name__}.exit_codes": "omni_core.commands.exit_codes",
        f"{__name__}.text_files": "omni_core.files",
    },
)
