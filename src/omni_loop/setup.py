"""Installs omni_loop as an ament_python package."""

from xml.etree import ElementTree

from setuptools import find_packages, setup

package = ElementTree.parse("package.xml").getroot()
name = package.findtext("name")

setup(
    name=name,
    version=package.findtext("version"),
    description=package.findtext("description"),
    license=package.findtext("license"),
    packages=find_packages(exclude=["test"]),
    python_requires=">=3.10",
    package_data={name: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{name}"]),
        (f"share/{name}", ["package.xml"]),
    ],
    extras_require={"test": ["pytest"]},  # by which colcon test knows the tests
    zip_safe=False,
)
