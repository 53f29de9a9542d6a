"""Installs omni_bringup as an ament_python package."""

from glob import glob
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

# The configuration of the workspace, so that launch files find it from anywhere.
CONFIG = Path("../../config")

package = ElementTree.parse("package.xml").getroot()
name = package.findtext("name")

setup(
    name=name,
    version=package.findtext("version"),
    description=package.findtext("description"),
    license=package.findtext("license"),
    packages=find_packages(exclude=["test"]),
    python_requires=">=3.10",
    package_data={name: ["py.typed", "drive/page/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{name}"]),
        (f"share/{name}", ["package.xml"]),
        (f"share/{name}/launch", sorted(glob("launch/*.launch.py"))),
        *(
            (f"share/{name}/config/{folder.name}", sorted(map(str, folder.glob("*.yaml"))))
            for folder in sorted(CONFIG.iterdir())
            if folder.is_dir()
        ),
    ],
    extras_require={"test": ["pytest"]},  # by which colcon test knows the tests
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "driver = omni_bringup.start_driver_node:main",
            "omni = omni_bringup.cli:main",
            "player = omni_bringup.start_player_node:main",
        ]
    },
)
