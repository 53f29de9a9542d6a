"""Installs omni_core as an ament_python package."""

import sys

sys.path.insert(0, "../omni_core")
from ament_package import install

install(requires=["llvmlite", "numba==0.68.*", "numpy", "rich"])
