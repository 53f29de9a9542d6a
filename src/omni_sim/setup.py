"""Installs omni_sim as an ament_python package."""

import sys

sys.path.insert(0, "../omni_core")
from ament_package import install

install(
    requires=["numba", "numpy", "omni_core", "pillow"],
    nodes={"simulator": "omni_sim.simulator_node"},
)
