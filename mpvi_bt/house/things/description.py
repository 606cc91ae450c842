"""What a thing is made of: bodies with colored solids, container volumes, handles and joints. No simulator here.

Body frames: the origin lies on the underside, in the middle; z points up and x to the front, the side that a thing is
used from (a cabinet's doors, a chair's seat edge, a car's boot).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array, Solid, pose

Color = tuple[float, float, float]  # sRGB, 0 to 1: as it looks under full light
Vector = tuple[float, float, float]
Axis = Literal["x", "y", "z"]

_Z_TO: dict[Axis, Array] = {
    "x": np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
    "y": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "z": np.eye(3),
}


@dataclass(frozen=True, eq=False)
class Part:
    """One colored solid of a body.

    Attributes:
        solid: In the body frame.
        color: sRGB, 0 to 1.
        collides: False for what is only seen, such as a rug or a window.
        hull: (V, 3) corners in the body frame [m]: what physics takes for it, convex, and `solid` is the box around it.
            None: physics takes the solid.
    """

    solid: Solid
    color: Color
    collides: bool = True
    hull: Array | None = None


@dataclass(frozen=True, eq=False)
class Skin:
    """Triangles of one color that cameras see of a body, instead of its parts.

    Attributes:
        color: sRGB, 0 to 1.
        vertices: (V, 3) in the body frame [m].
        triangles: (T, 3) indices, counterclockwise from outside.
    """

    color: Color
    vertices: Array
    triangles: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Handle:
    """A bar for a hand to close around. Geometry only; planners may read it.

    Attributes:
        center: (3,) middle of the bar, in the body frame [m].
        axis: (3,) unit vector along it.
        outward: (3,) unit vector from the thing to the bar's free side: a hand comes from there.
        length_m: Free length of the bar.
        thickness_m: Its diameter, or the side that fingers close on.
    """

    center: Array
    axis: Array
    outward: Array
    length_m: float
    thickness_m: float

    def moved(self, T: Array) -> Handle:
        """The same handle in the frame that `T` (4, 4) maps its own into."""
        R = T[:3, :3]
        center, axis, outward = matmul(R, self.center) + T[:3, 3], matmul(R, self.axis), matmul(R, self.outward)
        return replace(self, center=center, axis=axis, outward=outward)


@dataclass(frozen=True, eq=False)
class Switch:
    """A button that a fingertip can press.

    Attributes:
        center: (3,) middle of its face, in the body frame [m].
        outward: (3,) unit vector out of the thing.
        radius_m: Of what is seen of it.
        closed_only: Whether the thing is on only while it is closed: opening it turns it off.
    """

    center: Array
    outward: Array
    radius_m: float = 0.014
    closed_only: bool = False


@dataclass(frozen=True, eq=False)
class Joint:
    """How a body moves against the root body.

    Attributes:
        kind: A hinge turns [rad], a slide shifts [m].
        origin: (3,) of the moving body's frame in the root body's frame, at position 0 (closed); its axes are parallel.
        axis: (3,) unit vector of positive motion (opening), in the root body's frame.
        limit: Largest position; the smallest is 0.
        friction: Coulomb friction of the joint.
        damping: Viscous damping of the joint [N m s or N s/m].
        sprung: Gravity is balanced, as by the spring of an oven door or the gas strut of a car boot.
    """

    kind: Literal["hinge", "slide"]
    origin: Array
    axis: Array
    limit: float
    friction: float = 0.1
    damping: float = 1.0
    sprung: bool = False


@dataclass(frozen=True, eq=False)
class RigidBody:
    """One rigid body.

    Attributes:
        name: Unique in its thing, such as "body" or "door".
        parts: What it is made of.
        volumes: What can hold things, as boxes or cylinders in the body frame.
        handles: Bars to take hold of.
        joint: How it moves against the first body; None for the first body itself.
        switches: What turns the thing on and off.
        skin: What cameras see of it; (): its parts.
        blades: Parts of it that cut.
    """

    name: str
    parts: tuple[Part, ...]
    volumes: tuple[Solid, ...] = ()
    handles: tuple[Handle, ...] = ()
    joint: Joint | None = None
    switches: tuple[Switch, ...] = ()
    skin: tuple[Skin, ...] = ()
    blades: tuple[Solid, ...] = ()

    def frame(self, position: float = 0.0) -> Array:
        """(4, 4) this body to the root body, with its joint at `position` [rad or m]."""
        T = np.eye(4)
        if self.joint is not None:
            T[:3, 3] = self.joint.origin
            if self.joint.kind == "slide":
                T[:3, 3] += self.joint.axis * position
            else:
                T[:3, :3] = _turn(self.joint.axis, position)
        return T


@dataclass(frozen=True, eq=False)
class Description:
    """A thing: its first body is the root, every other one is joined to it."""

    bodies: tuple[RigidBody, ...]

    @property
    def root(self) -> RigidBody:
        """The first body."""
        return self.bodies[0]

    @property
    def jointed(self) -> bool:
        """Whether anything in it moves."""
        return len(self.bodies) > 1

    def solids(self, T: Array | None = None, openings: Mapping[str, float] | None = None) -> Iterator[Solid]:
        """Colliding solids, in the frame after `T` (4, 4, root body to frame).

        Args:
            T: None: the root body's own frame.
            openings: Body to the opening of its joint, 0 to 1; all others are closed.
        """
        frames = self.frames(openings or {})
        for body in self.bodies:
            frame = frames[body.name] if T is None else matmul(T, frames[body.name])
            for part in body.parts:
                if part.collides:
                    yield part.solid.moved(frame)

    def frames(self, openings: Mapping[str, float]) -> dict[str, Array]:
        """(4, 4) each body to the root body, by name. `openings`: as of `solids`."""
        return {
            body.name: body.frame(openings.get(body.name, 0.0) * (body.joint.limit if body.joint else 0.0))
            for body in self.bodies
        }

    def extent(self, T: Array | None = None, visible: bool = False) -> Array:
        """(2, 3) lowest and highest corner around it; with `visible`, also around what does not collide."""
        frame = np.eye(4) if T is None else T
        boxes = [
            part.solid.moved(matmul(frame, body.frame())).aabb()
            for body in self.bodies
            for part in body.parts
            if part.collides or visible
        ]
        if not boxes:
            return self.extent(T, visible=True)
        corners = np.stack(boxes)
        return np.stack([corners[:, 0].min(0), corners[:, 1].max(0)])


def switch(center: Vector, outward: Axis, closed_only: bool = False) -> Switch:
    """A switch on a face that looks along an axis of the body frame."""
    return Switch(np.array(center, float), _Z_TO[outward][:, 2], closed_only=closed_only)


@dataclass
class PartsOfBody:
    """Collects the parts of one body."""

    items: list[Part] = field(default_factory=list)

    def box(self, center: Vector, size: Vector, color: Color, *, yaw: float = 0.0, collides: bool = True) -> None:
        """A box of full `size` [m] about `center`, turned by `yaw` [rad]."""
        self.items.append(Part(Solid("box", np.asarray(size, float) / 2, pose(center, yaw)), color, collides))

    def cylinder(
        self, center: Vector, diameter: float, length: float, color: Color, *, axis: Axis = "z", collides: bool = True
    ) -> None:
        """A cylinder about `center`, lying along `axis` [m]."""
        T = pose(center)
        T[:3, :3] = _Z_TO[axis]
        half = np.array([diameter / 2, diameter / 2, length / 2])
        self.items.append(Part(Solid("cylinder", half, T), color, collides))

    def sphere(self, center: Vector, diameter: float, color: Color, *, collides: bool = True) -> None:
        """A sphere about `center` [m]."""
        self.items.append(Part(Solid("sphere", np.full(3, diameter / 2), pose(center)), color, collides))

    def bar(self, center: Vector, along: Array, length: float, thick: float, face: float, color: Color) -> None:
        """A round bar along y or z to take hold of [m], with two posts back to a face at x = `face`."""
        self.cylinder(center, thick, length, color, axis="y" if along[1] else "z")
        for sign in (-1, 1):
            post = np.array(center) + sign * along * (length / 2 - 0.012)
            gap = center[0] - face
            self.box((face + gap / 2, float(post[1]), float(post[2])), (gap, 0.012, 0.012), color)

    def body(
        self,
        name: str = "body",
        volumes: tuple[Solid, ...] = (),
        handles: tuple[Handle, ...] = (),
        joint: Joint | None = None,
        switches: tuple[Switch, ...] = (),
        blades: tuple[Solid, ...] = (),
    ) -> RigidBody:
        """The body that has these parts."""
        return RigidBody(name, tuple(self.items), volumes, handles, joint, switches, blades=blades)

    def thing(
        self,
        volumes: tuple[Solid, ...] = (),
        handles: tuple[Handle, ...] = (),
        switches: tuple[Switch, ...] = (),
        blades: tuple[Solid, ...] = (),
    ) -> Description:
        """A thing of this one body."""
        return Description((self.body(volumes=volumes, handles=handles, switches=switches, blades=blades),))


def _turn(axis: Array, angle: float) -> Array:
    """(3, 3) rotation by `angle` [rad] about the unit vector `axis`."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * matmul(K, K))
