"""A robot's links and joints, read from a URDF, with the place of everything in the file."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeVar

from mpvi_bt.ground.errors import FileProblems, Problem, did_you_mean, nearest, shown
from mpvi_bt.ground.marked_xml import Element, parse_xml
from mpvi_bt.ground.marked_yaml import MAX_PROBLEMS, read_text

T = TypeVar("T")

Vector = tuple[float, float, float]
Place = tuple[int, int]
_KINDS = ("fixed", "revolute", "continuous", "prismatic", "floating", "planar")
_MOVING = ("revolute", "continuous", "prismatic")
_ZERO: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class UrdfShape:
    """A primitive or a mesh of a link.

    Attributes:
        kind: What it is.
        size: Of a box its sides, of a cylinder radius and length, of a sphere its radius [m]; of a mesh its scale.
        file: Of a mesh, as the URDF names it.
        xyz, rpy: Its place in the link's frame [m, rad].
        place: (line, column) in the file.
    """

    kind: Literal["box", "cylinder", "sphere", "mesh"]
    size: tuple[float, ...]
    file: str
    xyz: Vector
    rpy: Vector
    place: Place


@dataclass(frozen=True)
class UrdfLink:
    """A link: its name, place in the file, and what of it is seen and may touch."""

    name: str
    place: Place
    visuals: tuple[UrdfShape, ...] = ()
    collisions: tuple[UrdfShape, ...] = ()


@dataclass(frozen=True)
class UrdfJoint:
    """A joint.

    Attributes:
        name: Of the joint.
        kind: Such as "revolute".
        parent, child: Links.
        xyz, rpy: Place of the child in the parent at position 0 [m, rad].
        axis: (3,) unit vector in the child's frame.
        limits: Lowest and highest position [m or rad]; none of a continuous joint, or where the file has none.
        velocity: The most [m/s or rad/s]; None: the file has none.
        mimic: Joint that it follows, with factor and offset; None: it moves by itself.
        place: (line, column) in the file.
    """

    name: str
    kind: str
    parent: str
    child: str
    xyz: Vector
    rpy: Vector
    axis: Vector
    limits: tuple[float, float] | None
    velocity: float | None
    mimic: tuple[str, float, float] | None
    place: Place

    @property
    def moves(self) -> bool:
        """Whether it is a joint with one number of its own."""
        return self.kind in _MOVING and self.mimic is None


@dataclass(frozen=True)
class UrdfTree:
    """A robot of a URDF. Its links hang together as a tree.

    Attributes:
        file: Where it was read.
        name: Of the robot.
        text: Of the file.
        links, joints: By name, in the file's order.
        root: The link that hangs on no joint.
    """

    file: str
    name: str
    text: str
    links: dict[str, UrdfLink]
    joints: dict[str, UrdfJoint]
    root: str
    _into: dict[str, UrdfJoint] = field(repr=False)

    def path(self, link: str, above: str | None = None) -> list[UrdfJoint] | None:
        """The joints from a link (the root) down to another one; None if it does not hang below it."""
        top = self.root if above is None else above
        found: list[UrdfJoint] = []
        while link != top:
            if (joint := self._into.get(link)) is None:
                return None
            found.append(joint)
            link = joint.parent
        return found[::-1]

    def below(self, link: str) -> Iterator[UrdfJoint]:
        """The joints that a link carries directly."""
        return (joint for joint in self.joints.values() if joint.parent == link)

    def missing_meshes(self) -> Iterator[Problem]:
        """A note for each mesh that is not there: robots move without them, and are drawn without them."""
        folder, seen = Path(self.file).resolve().parent, set[str]()
        for link in self.links.values():
            for shape in (*link.visuals, *link.collisions):
                if shape.kind == "mesh" and shape.file not in seen and mesh_file(shape.file, folder) is None:
                    seen.add(shape.file)
                    message = f"mesh {shown(shape.file)} of link {link.name!r} is not there; it is not needed to drive"
                    yield Problem(self.file, *shape.place, "missing-mesh", message, severity="note")


def mesh_file(given: str, folder: Path) -> Path | None:
    """A file that a URDF in `folder` names: from there, or, of a package, from a folder above; None: there is none."""
    name = given.removeprefix("package://").removeprefix("file://")
    return next((above / name for above in (folder, *folder.parents) if (above / name).is_file()), None)


def read_urdf_tree(file: str | Path) -> UrdfTree:
    """The robot of a URDF.

    Raises:
        UserError: There is no such file.
        FileProblems: Everything that is wrong with it; xacro, too, which has to be expanded first.
    """
    text = read_text(file)
    return _UrdfReader(text, str(file)).read()


class _UrdfReader:
    def __init__(self, text: str, file: str) -> None:
        self._text, self._file = text, file
        self._problems: list[Problem] = []

    def read(self) -> UrdfTree:
        root = parse_xml(self._text, self._file)
        if (xacro := _xacro(root)) is not None:
            how = f"`xacro {Path(self._file).name} > robot.urdf` (of ROS, or `pip install xacro`)"
            message = f"this is xacro, which stands for a URDF; expand it: {how}"
            raise FileProblems([Problem(self._file, *xacro.place, "wrong-kind", message)])
        if root.tag != "robot":
            message = f"this is no URDF: its outermost element is <{root.tag}>, not <robot>"
            raise FileProblems([Problem(self._file, *root.place, "wrong-kind", message)])
        links = self._named(root, "link", self._link)
        joints = self._named(root, "joint", self._joint)
        into = self._hung(links, joints)
        self._check_mimics(joints)
        top = [link for name, link in links.items() if name not in into]
        if not links:
            self._tell(root.place, "missing-key", "there is no <link>")
        elif not top:
            self._tell(root.place, "no-root", "its joints run in a circle: no link is the first one")
        for other in top[1:]:
            message = f"link {other.name!r} hangs on no joint, and neither does {top[0].name!r}: a robot has one root"
            self._tell(other.place, "two-roots", message)
        if not self._problems and (lost := self._lost(links, into)) is not None:
            self._tell(lost.place, "no-root", f"link {lost.name!r} is in a circle of joints")
        if self._problems:
            raise FileProblems(self._problems[:MAX_PROBLEMS])
        name = root.attributes.get("name", "")
        return UrdfTree(self._file, name, self._text, links, joints, top[0].name, into)

    def _tell(self, place: Place, code: str, message: str) -> None:
        self._problems.append(Problem(self._file, *place, code, message))

    def _named(self, root: Element, tag: str, read: Callable[[str, Element], T | None]) -> dict[str, T]:
        """Elements of a tag by name, each read."""
        found: dict[str, T] = {}
        for element in root.children:
            if element.tag != tag:
                continue
            name = element.attributes.get("name", "")
            if not name:
                self._tell(element.place, "missing-key", f"a <{tag}> without a name")
            elif name in found:
                self._tell(element.place, "duplicate", f"a second {tag} {name!r}")
            elif (made := read(name, element)) is not None:
                found[name] = made
        return found

    def _link(self, name: str, element: Element) -> UrdfLink:
        visuals = tuple(self._shapes(element, "visual"))
        return UrdfLink(name, element.place, visuals, tuple(self._shapes(element, "collision")))

    def _shapes(self, link: Element, tag: str) -> Iterator[UrdfShape]:
        for element in link.children:
            if element.tag != tag:
                continue
            xyz, rpy = self._origin(element)
            for form in (inner for child in element.children if child.tag == "geometry" for inner in child.children):
                if form.tag == "box":
                    yield UrdfShape("box", self._vector(form, "size", _ZERO), "", xyz, rpy, form.place)
                elif form.tag == "cylinder":
                    size = (self._number(form, "radius"), self._number(form, "length"))
                    yield UrdfShape("cylinder", size, "", xyz, rpy, form.place)
                elif form.tag == "sphere":
                    yield UrdfShape("sphere", (self._number(form, "radius"),), "", xyz, rpy, form.place)
                elif form.tag == "mesh":
                    scale = self._vector(form, "scale", (1.0, 1.0, 1.0))
                    yield UrdfShape("mesh", scale, form.attributes.get("filename", ""), xyz, rpy, form.place)

    def _joint(self, name: str, element: Element) -> UrdfJoint | None:
        kind = element.attributes.get("type", "")
        if kind not in _KINDS:
            hint = did_you_mean(nearest(kind, _KINDS), _KINDS)
            self._tell(
                element.places.get("type", element.place), "unknown-value", f"joint {name!r}: type {shown(kind)}.{hint}"
            )
            return None
        ends = {end: (_child(element, end) or element).attributes.get("link", "") for end in ("parent", "child")}
        for end, link in ends.items():
            if not link:
                self._tell(element.place, "missing-key", f"joint {name!r} has no <{end} link=...>")
        if not all(ends.values()):
            return None
        xyz, rpy = self._origin(element)
        along = _child(element, "axis")
        axis = (1.0, 0.0, 0.0) if along is None else self._vector(along, "xyz", (1.0, 0.0, 0.0))
        length = math.sqrt(sum(x * x for x in axis))
        if length < 1e-6 and kind not in ("fixed", "floating"):
            self._tell((along or element).place, "out-of-range", f"joint {name!r}: an axis of length 0")
        axis = (axis[0] / (length or 1.0), axis[1] / (length or 1.0), axis[2] / (length or 1.0))
        limits, velocity = self._limits(name, kind, element)
        return UrdfJoint(name, kind, ends["parent"], ends["child"], xyz, rpy, axis, limits, velocity,
                         self._mimic(element) if kind in _MOVING else None, element.place)  # fmt: skip

    def _limits(self, name: str, kind: str, element: Element) -> tuple[tuple[float, float] | None, float | None]:
        limit = _child(element, "limit")
        if limit is None:
            return None, None
        velocity = self._number(limit, "velocity") if "velocity" in limit.attributes else None
        if kind == "continuous" or not {"lower", "upper"} & limit.attributes.keys():
            return None, velocity
        low, high = (self._number(limit, end) if end in limit.attributes else 0.0 for end in ("lower", "upper"))
        if low > high:
            message = f"joint {name!r}: its lowest position {low:g} is above its highest {high:g}"
            self._tell(limit.place, "out-of-range", message)
        return (low, high), velocity

    def _mimic(self, element: Element) -> tuple[str, float, float] | None:
        mimic = _child(element, "mimic")
        if mimic is None:
            return None
        factor = self._number(mimic, "multiplier") if "multiplier" in mimic.attributes else 1.0
        offset = self._number(mimic, "offset") if "offset" in mimic.attributes else 0.0
        return mimic.attributes.get("joint", ""), factor, offset

    def _origin(self, element: Element) -> tuple[Vector, Vector]:
        origin = _child(element, "origin")
        if origin is None:
            return _ZERO, _ZERO
        return self._vector(origin, "xyz", _ZERO), self._vector(origin, "rpy", _ZERO)

    def _vector(self, element: Element, name: str, default: Vector) -> Vector:
        if name not in element.attributes:
            return default
        try:
            x, y, z = map(float, element.attributes[name].split())
        except ValueError:
            x = y = z = math.nan
        if not all(map(math.isfinite, (x, y, z))):
            message = f"{name} should be three numbers, not {shown(element.attributes[name])}"
            self._tell(element.places.get(name, element.place), "wrong-type", message)
            return default
        return x, y, z

    def _number(self, element: Element, name: str) -> float:
        text = element.attributes.get(name, "")
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            message = f"{name} of <{element.tag}> should be a number, not {shown(text)}"
            self._tell(element.places.get(name, element.place), "wrong-type", message)
            return 0.0
        return number

    def _hung(self, links: dict[str, UrdfLink], joints: dict[str, UrdfJoint]) -> dict[str, UrdfJoint]:
        """The joint that each link hangs on; tells of links that are not there, and of two joints for one."""
        into: dict[str, UrdfJoint] = {}
        for joint in joints.values():
            for link in (joint.parent, joint.child):
                if link not in links:
                    whose = f" of joint {joint.name!r}"
                    self._problems.append(Problem.unknown(self._file, joint.place, "link", link, links, whose))
            if joint.child in into:
                message = f"link {joint.child!r} hangs on two joints, {into[joint.child].name!r} and {joint.name!r}"
                self._tell(joint.place, "duplicate", message)
            into[joint.child] = joint
        return into

    def _check_mimics(self, joints: dict[str, UrdfJoint]) -> None:
        for joint in joints.values():
            if joint.mimic is None:
                continue
            followed = joints.get(joint.mimic[0])
            if followed is None:
                whose = f", which {joint.name!r} follows"
                self._problems.append(Problem.unknown(self._file, joint.place, "joint", joint.mimic[0], joints, whose))
            elif not followed.moves:
                message = f"joint {joint.name!r} follows {followed.name!r}, which does not move by itself"
                self._tell(joint.place, "out-of-range", message)

    def _lost(self, links: dict[str, UrdfLink], into: dict[str, UrdfJoint]) -> UrdfLink | None:
        """A link from which no way leads up to the root."""
        for link in links.values():
            at, seen = link.name, set[str]()
            while at in into and at not in seen:
                seen.add(at)
                at = into[at].parent
            if at in seen:
                return link
        return None


def _child(element: Element, tag: str) -> Element | None:
    return next((child for child in element.children if child.tag == tag), None)


def _xacro(root: Element) -> Element | None:
    """The first element that only xacro has."""
    left = [root]
    while left:
        element = left.pop(0)
        if element.tag.startswith("xacro:") or any(
            "${" in text or "$(" in text for text in element.attributes.values()
        ):
            return element
        left = element.children + left
    return None
