"""The elements of a URDF: links of boxes, cylinders and spheres, and the joints between them."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence

from mpvi_bt.ground.geometry.solids import Array

Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)
WHITE, DARK, BLUE, ORANGE, BLACK = (
    (0.92, 0.92, 0.94), (0.18, 0.19, 0.22), (0.15, 0.35, 0.75), (0.95, 0.55, 0.10), (0.02, 0.02, 0.02)
)  # fmt: skip


def add_link(robot: ET.Element, name: str, mass: float, inertia: Sequence[float], com: Vector = ZERO) -> ET.Element:
    """Add a link with its mass [kg] and the diagonal (3,) of its inertia [kg m^2]; returns it, for its shapes."""
    link = ET.SubElement(robot, "link", name=name)
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=text(com))
    ET.SubElement(inertial, "mass", value=str(mass))
    xx, yy, zz = map(str, inertia)
    ET.SubElement(inertial, "inertia", ixx=xx, iyy=yy, izz=zz, ixy="0", ixz="0", iyz="0")
    return link


def add_visual(
    link: ET.Element, kind: str, size: Sequence[float], at: Vector, color: Vector, rpy: Vector = ZERO
) -> None:
    """Add something to see: "box" (sizes), "cylinder" (radius, length) or "sphere" (radius,) [m], turned by rpy."""
    visual = _shape(link, "visual", kind, size, at, rpy)
    material = ET.SubElement(visual, "material", name="-".join(map(str, color)))
    ET.SubElement(material, "color", rgba=text((*color, 1.0)))


def add_collision(link: ET.Element, kind: str, size: Sequence[float], at: Vector) -> None:
    """Add something to touch, sized as of `add_visual`."""
    _shape(link, "collision", kind, size, at)


def _shape(link: ET.Element, tag: str, kind: str, size: Sequence[float], at: Vector, rpy: Vector = ZERO) -> ET.Element:
    element = ET.SubElement(link, tag)
    ET.SubElement(element, "origin", xyz=text(at), rpy=text(rpy))
    geometry = ET.SubElement(element, "geometry")
    if kind == "box":
        ET.SubElement(geometry, "box", size=text(size))
    elif kind == "cylinder":
        ET.SubElement(geometry, "cylinder", radius=str(size[0]), length=str(size[1]))
    else:
        ET.SubElement(geometry, "sphere", radius=str(size[0]))
    return element


def add_joint(
    robot: ET.Element, name: str, kind: str, parent: str, child: str, xyz: Vector = ZERO, rpy: Vector = ZERO,
    axis: Vector | None = None, limits: tuple[float, ...] | None = None, effort: float = 100, speed: float = 2,
) -> None:  # fmt: skip
    """Add a joint between two links; places [m], turns and limits [rad] or [m]."""
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(joint, "origin", xyz=text(xyz), rpy=text(rpy))
    if axis:
        ET.SubElement(joint, "axis", xyz=text(axis))
    if limits:
        low, high = map(str, limits)
        ET.SubElement(joint, "limit", lower=low, upper=high, effort=str(effort), velocity=str(speed))


def add_base_joints(robot: ET.Element, names: tuple[str, str, str]) -> None:
    """Add what moves "base_link" over the floor: joints of these names along x, along y and about z, from "root"."""
    x, y, yaw = names
    for name in ("root", "root_x", "root_y"):
        add_link(robot, name, 1.0, (1e-2, 1e-2, 1e-2))
    add_joint(robot, x, "prismatic", "root", "root_x", axis=(1, 0, 0), limits=(-50, 50), effort=1000, speed=1)
    add_joint(robot, y, "prismatic", "root_x", "root_y", axis=(0, 1, 0), limits=(-50, 50), effort=1000, speed=1)
    add_joint(robot, yaw, "continuous", "root_y", "base_link", axis=(0, 0, 1))


def box_inertia(mass: float, x: float, y: float, z: float) -> Vector:
    """The diagonal of the inertia [kg m^2] of a box of sizes [m]."""
    return (mass * (y * y + z * z) / 12, mass * (x * x + z * z) / 12, mass * (x * x + y * y) / 12)


def vector(v: Array) -> Vector:
    """An array (3,) as plain numbers."""
    return (float(v[0]), float(v[1]), float(v[2]))


def text(v: Sequence[float]) -> str:
    """Numbers as a URDF has them."""
    return " ".join(f"{x:.9g}" for x in v)
