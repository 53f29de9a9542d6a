"""Links and joints of a robot description (URDF).

Frames are those of the URDF: a joint gives the pose of its child link in its parent link, and axis,
masses and shapes are in the frame of their link. Poses are matrices of shape (4, 4) that map
coordinates of a frame to those of its parent, or of another frame; all joints are at zero.
"""

import itertools
import math
import warnings
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple, TypeVar
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from omni_core.configuration import ConfigurationError
from omni_core.quantities import FloatArray
from omni_core.sensors import rotation_matrix
from omni_tools.robot_files.refusal import refused

# Attributes of a shape whose multiples are half of the edges of the box around it.
_SHAPES = {
    "box": {"size": (0.5, 0.5, 0.5)},
    "cylinder": {"radius": (1.0, 1.0, 0.0), "length": (0.0, 0.0, 0.5)},
    "sphere": {"radius": (1.0, 1.0, 1.0)},
}


class Shape(NamedTuple):
    """A box, cylinder or sphere of a link.

    Attributes:
        kind: ``box``, ``cylinder`` (about its z axis) or ``sphere``.
        half: half of the edges of the box around it, along the axes of its pose [m], shape (3,).
        pose: pose in the link, or in the base of the robot.
        of: ``collision`` or ``visual``.
    """

    kind: str
    half: FloatArray
    pose: FloatArray
    of: str

    @property
    def corners(self) -> FloatArray:
        """Corners of the box around the shape, in the frame of its pose [m], shape (8, 3)."""
        signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
        return np.asarray(signs * self.half @ self.pose[:3, :3].T + self.pose[:3, 3])


class Link(NamedTuple):
    """A link.

    Attributes:
        name: name of the link.
        mass: mass [kg]; 0 if none is given.
        center: center of gravity [m], shape (3,).
        inertia: moments of inertia about the center of gravity [kg m^2], shape (3, 3).
        shapes: collision shapes, then visual shapes; without meshes.
        meshes: number of meshes.
    """

    name: str
    mass: float
    center: FloatArray
    inertia: FloatArray
    shapes: tuple[Shape, ...]
    meshes: int


class Joint(NamedTuple):
    """A joint.

    Attributes:
        name: name of the joint.
        kind: type of the joint, such as ``continuous``.
        parent: name of the parent link.
        child: name of the child link.
        pose: pose of the child link in the parent link.
        axis: unit vector of the axis in the child link, shape (3,).
    """

    name: str
    kind: str
    parent: str
    child: str
    pose: FloatArray
    axis: FloatArray


_Part = TypeVar("_Part", Link, Joint)


class Robot:
    """Tree of the links of a robot.

    Attributes:
        file: name of the file, for messages.
        links: links, keyed by name.
        joints: joints, keyed by name.
        parents: joint that holds a link, keyed by link; the root has none.
        base: name of the link in whose frame poses are given; the root unless it is changed.
        driven: names of the joints that ros2_control drives by velocity alone.
        grips: directions of friction for Gazebo, keyed by link.

    Raises:
        ConfigurationError: the text is not a URDF, a value is invalid, or the links form no tree.
    """

    def __init__(self, file: str, text: str, partial: bool = False) -> None:
        """Read a description.

        Args:
            file: name of the file.
            text: the URDF.
            partial: whether links are left out that others, which are missing, connect.
        """
        self.file = file
        try:
            root = ElementTree.fromstring(text)
        except (ElementTree.ParseError, ValueError) as error:
            raise self._wrong(f"is not valid XML: {error}") from None
        if root.tag != "robot":
            problem = f"is not a URDF: its first element is <{root.tag}>, not <robot>"
            raise self._wrong(f"{problem}; give the URDF or xacro file of the robot")
        self.links = self._by_name(self._link(one) for one in root.findall("link"))
        self.joints = self._by_name(self._joint(one) for one in root.findall("joint"))
        if partial and self.links:
            self._keep_connected()
        driven = root.findall("ros2_control/joint/command_interface[@name='velocity']/..")
        # The joints of arms have commands of position, too.
        arms = root.findall("ros2_control/joint/command_interface[@name='position']/..")
        self.driven = [joint.get("name", "") for joint in driven if joint not in arms]
        self.grips = {
            element.get("reference", ""): direction
            for element in root.findall("gazebo")
            if (direction := element.find(".//fdir1")) is not None
        }
        self.base = self._root()
        for name in self.links:
            self.chain(name)

    def grip(self, link: str) -> FloatArray | None:
        """Return the direction of a link's larger friction in Gazebo, shape (3,); None if unknown.

        It is `fdir1` in the frame `expressed_in`, or in that of the link.
        """
        element = self.grips.get(link)
        if element is None:
            return None
        frame = next((one for one in element.attrib.values() if one in self.links), link)
        try:
            direction = np.array([float(word) for word in (element.text or "").split()])
            return np.asarray(self.pose(frame)[:3, :3] @ direction)
        except ValueError:
            return None

    def _wrong(self, problem: str) -> ConfigurationError:
        return refused(f"{self.file} {problem}")

    def _by_name(self, parts: Iterable[_Part]) -> dict[str, _Part]:
        found: dict[str, _Part] = {}
        for part in parts:
            if part.name in found:
                kind = type(part).__name__.lower()
                raise self._wrong(f"has two {kind}s named {part.name!r}; rename one of them")
            found[part.name] = part
        return found

    def _keep_connected(self) -> None:
        """Keep the links below the root of most links, and their joints."""
        links, joints = self.links.keys(), self.joints.items()
        self.joints = {n: one for n, one in joints if {one.parent, one.child} <= links}
        self.parents = {joint.child: joint for joint in self.joints.values()}
        roots = {name: [name, *(one.parent for one in self.chain(name))][-1] for name in self.links}
        ((largest, _),) = Counter(roots.values()).most_common(1)
        self.links = {name: one for name, one in self.links.items() if roots[name] == largest}
        self.joints = {n: one for n, one in self.joints.items() if one.child in self.links}

    def _root(self) -> str:
        """Enter the joint that holds each link, and return the link that none holds."""
        if not self.links:
            problem = (
                "has no links; give the file of the robot, which includes it, and the packages"
            )
            raise self._wrong(f"{problem} that it includes")
        self.parents = {}
        for joint in self.joints.values():
            for link in (joint.parent, joint.child):
                if link not in self.links:
                    raise self._wrong(f"lacks the link {link!r} of the joint {joint.name!r}")
            other = self.parents.setdefault(joint.child, joint)
            if other is not joint:
                raise self._wrong(
                    f"has two joints, {other.name!r} and {joint.name!r}, for the link "
                    f"{joint.child!r}"
                )
        roots = [name for name in self.links if name not in self.parents]
        if len(roots) != 1:
            raise self._wrong(
                f"has {len(roots)} links that no joint holds ({', '.join(roots[:4]) or 'a loop'}); "
                "give the description of one robot, whose links form one tree"
            )
        return roots[0]

    def chain(self, link: str) -> list[Joint]:
        """Return the joints from the root to a link, nearest to the link first."""
        joints: list[Joint] = []
        while link in self.parents:
            joints.append(self.parents[link])
            link = joints[-1].parent
            if len(joints) > len(self.joints):
                raise self._wrong(f"has a loop of joints through the link {link!r}")
        return joints

    def pose(self, link: str) -> FloatArray:
        """Return the pose of a link in the frame of the link `base`, shape (4, 4)."""
        return np.asarray(np.linalg.solve(self._in_root(self.base), self._in_root(link)))

    def _in_root(self, link: str) -> FloatArray:
        joint = self.parents.get(link)
        return np.eye(4) if joint is None else self._in_root(joint.parent) @ joint.pose

    def below(self, link: str) -> list[str]:
        """Return a link and all links that its joints hold."""
        return [
            name
            for name in self.links
            if name == link or any(joint.parent == link for joint in self.chain(name))
        ]

    def rigid(self, link: str) -> list[str]:
        """Return the links that fixed joints connect with a link, and the link itself."""

        def moved_by(name: str) -> str:
            return next((joint.name for joint in self.chain(name) if joint.kind != "fixed"), "")

        return [name for name in self.links if moved_by(name) == moved_by(link)]

    def shapes(self, links: Iterable[str]) -> list[Shape]:
        """Return the shapes of some links, with poses in the frame of the link `base`."""
        return [
            shape._replace(pose=self.pose(name) @ shape.pose)
            for name in links
            for shape in self.links[name].shapes
        ]

    def body(self, links: Sequence[str]) -> tuple[float, FloatArray, FloatArray]:
        """Return mass and moments of inertia of some links as one rigid body.

        Args:
            links: names of the links.

        Returns:
            Mass [kg]; center of gravity in the frame of the link `base` [m], shape (3,); moments of
            inertia about it along the axes of this frame [kg m^2], shape (3, 3).
        """
        parts, poses = [self.links[name] for name in links], [self.pose(name) for name in links]
        masses, turn = np.array([one.mass for one in parts]), np.array(poses)[:, :3, :3]
        inertia = turn @ [one.inertia for one in parts] @ turn.transpose(0, 2, 1)
        centers = np.einsum("nij,nj->ni", poses, [(*one.center, 1.0) for one in parts])[:, :3]
        mass = float(np.sum(masses))
        center = masses @ centers / (mass or 1.0)
        arms = centers - center
        spread = arms.T @ (masses[:, np.newaxis] * arms)
        return mass, center, np.sum(inertia, axis=0) + np.trace(spread) * np.eye(3) - spread

    def _link(self, element: ElementTree.Element) -> Link:
        name = element.get("name", "")
        place = f"link {name!r}"
        mass = float(self._numbers(element.find("inertial/mass"), "value", "0", 1, place)[0])
        pose = self._pose(element.find("inertial/origin"), place)
        tensor = element.find("inertial/inertia")
        keys = ("ixx", "ixy", "ixz", "ixy", "iyy", "iyz", "ixz", "iyz", "izz")
        moments = [self._numbers(tensor, key, "0", 1, place) for key in keys]
        if mass < 0.0:
            raise self._wrong(f"has the mass {mass:g} kg in the link {name!r}")
        shapes = [
            self._shape(one, kind, name)
            for kind in ("collision", "visual")
            for one in element.findall(kind)
        ]
        known = tuple(shape for shape in shapes if shape is not None)
        inertia = np.asarray(pose[:3, :3] @ np.reshape(moments, (3, 3)) @ pose[:3, :3].T)
        return Link(name, mass, pose[:3, 3], inertia, known, len(shapes) - len(known))

    def _shape(self, element: ElementTree.Element, of: str, link: str) -> Shape | None:
        for kind, keys in _SHAPES.items():
            solid = element.find(f"geometry/{kind}")
            if solid is not None:
                place = f"{of} of the link {link!r}"
                count = 3 if kind == "box" else 1
                sizes = [self._numbers(solid, key, "", count, place) for key in keys]
                if min(map(np.min, sizes)) < 0.0:
                    raise self._wrong(f"has a negative size of the {kind} in the {place}")
                half = np.sum(np.multiply(sizes, list(keys.values())), axis=0)
                return Shape(kind, half, self._pose(element.find("origin"), place), of)
        return None

    def _joint(self, element: ElementTree.Element) -> Joint:
        name = element.get("name", "")
        place = f"joint {name!r}"
        parent, child = (element.find(f"{key}[@link]") for key in ("parent", "child"))
        if parent is None or child is None:
            raise self._wrong(f"lacks the parent link or the child link of the {place}")
        axis = self._numbers(element.find("axis"), "xyz", "1 0 0", 3, place)
        length = float(np.linalg.norm(axis))
        axis = axis / length if length > 0.0 else axis
        pose = self._pose(element.find("origin"), place)
        ends = parent.attrib["link"], child.attrib["link"]
        return Joint(name, element.get("type", ""), *ends, pose, axis)

    def _pose(self, element: ElementTree.Element | None, place: str) -> FloatArray:
        pose = np.eye(4)
        pose[:3, 3] = self._numbers(element, "xyz", "0 0 0", 3, place)
        angles = self._numbers(element, "rpy", "0 0 0", 3, place)
        pose[:3, :3] = rotation_matrix(np.degrees(angles).tolist())
        return pose

    def _numbers(
        self, element: ElementTree.Element | None, key: str, usual: str, count: int, place: str
    ) -> FloatArray:
        """Return the numbers of an attribute, shape (count,).

        Args:
            element: element with the attribute; None if it is missing.
            key: name of the attribute.
            usual: text that takes the place of a missing one.
            count: required number of numbers.
            place: where the attribute is, for messages.
        """
        text = usual if element is None else element.get(key) or usual
        try:
            values = np.array([float(word) for word in text.split()])
        except ValueError:
            values = np.array([math.nan])
        if len(values) != count or not np.all(np.isfinite(values)):
            words = "a number" if count == 1 else f"{count} numbers"
            raise self._wrong(f"has {text!r} in {key} of the {place}, must be {words}")
        return values


def roll_pitch_yaw(pose: FloatArray) -> list[float]:
    """Return roll, pitch and yaw of a pose, as ``rpy`` of a joint but in deg.

    Args:
        pose: matrix of shape (4, 4).
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # at a pitch of 90 deg, roll and yaw turn about one axis
        angles = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", degrees=True)
    return [round(float(angle), 4) + 0.0 for angle in angles]
