"""Installs omni_studies as an ament_python package."""

import sys

sys.path.insert(0, "../omni_platform")
from ament_package import install

install(data=["claims.yaml", "limits.yaml"])
