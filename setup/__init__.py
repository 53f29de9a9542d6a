"""Set-up of the workspace, started by `./omni`: environment, build and kernels."""
