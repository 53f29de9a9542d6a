"""Shared part of the ``setup.py`` of all packages."""

from collections.abc import Iterable, Mapping
from xml.etree import ElementTree

from setuptools import find_packages, setup


def install(
    requires: Iterable[str] = (),
    nodes: Mapping[str, str] = {},
    commands: Mapping[str, str] = {},
    programs: Iterable[str] = (),
    data: Iterable[str] = (),
    shared: Iterable[tuple[str, list[str]]] = (),
) -> None:
    """Install the package that ``package.xml`` in this folder describes (ament_python).

    Args:
        requires: packages that pip installs for the core; the nodes also require ROS.
        nodes: module of each node, keyed by the name of its executable, see `omni_ros.start`.
        commands: module of each command, keyed by its name, see `omni_core.commands`.
        programs: entry points of other executables, as ``name = module:function``.
        data: patterns of the data files in the folders of the modules.
        shared: pairs of a folder below ``share/<package>`` and the list of its files.
    """
    package = ElementTree.parse("package.xml").getroot()
    name = str(package.findtext("name"))
    setup(
        name=name,
        version=package.findtext("version"),
        description=package.findtext("description"),
        license=package.findtext("license"),
        packages=find_packages(exclude=["test"]),
        python_requires=">=3.10",
        install_requires=list(requires),
        package_data={name: ["py.typed", *data]},
        data_files=[
            ("share/ament_index/resource_index/packages", [f"resource/{name}"]),
            (f"share/{name}", ["package.xml"]),
            *((f"share/{name}/{folder}", files) for folder, files in shared),
        ],
        extras_require={"test": ["pytest"]},  # through this entry `colcon test` finds the tests
        zip_safe=False,
        entry_points={
            "console_scripts": [*programs, *(f"{name} = omni_ros.start:main" for name in nodes)],
            "omni_nodes": [f"{name} = {module}" for name, module in nodes.items()],
            "omni.commands": [f"{name} = {module}" for name, module in commands.items()],
        },
    )
