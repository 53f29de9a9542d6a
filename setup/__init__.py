"""Makes the workspace ready: environment, build and kernels; what `./omni` starts."""
