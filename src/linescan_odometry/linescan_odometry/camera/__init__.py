"""Old name of `omni_vehicle.camera`."""

from omni_core.renamed import forward_imports

forward_imports(__name__, {__name__: "omni_vehicle.camera"})
