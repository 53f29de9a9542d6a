"""Installs omni_studies as an ament_python package."""

import sys

sys.path.insert(0, "../omni_core")
from ament_package import install

install(commands={"study": "omni_studies.command"}, data=["claims.yaml", "limits.yaml"])
