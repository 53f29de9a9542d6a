"""Installs omni_ros as an ament_python package."""

import sys

sys.path.insert(0, "../omni_core")
from ament_package import install

install(data=["*.xml"])
