"""Installs omni_sim as an ament_python package."""

import sys

sys.path.insert(0, "../omni_platform")
from ament_package import install

install(
    requires=["llvmlite", "numba", "numpy", "omni_platform", "pillow"],
    programs=["simulator = omni_sim.start_simulator_node:main"],
)
