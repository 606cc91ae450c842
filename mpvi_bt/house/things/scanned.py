"""The family of things whose shape is a mesh from a file."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from mpvi_bt.ground.errors import UnknownName, UserError
from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array, bounds, box
from mpvi_bt.ground.marked_yaml import Coordinate, Record
from mpvi_bt.house.things.description import Description, Joint, Part, RigidBody, Skin
from mpvi_bt.house.things.mesh_file import MeshBody, read_mesh
from mpvi_bt.house.things.pieces import Piece

_GRAY = (0.5, 0.5, 0.5)
_ROOT = "body"


class MeshJoint(Record):
    """How a body of a mesh moves against the one called "body".

    Attributes:
        kind: A hinge turns, a slide shifts.
        origin: A point on its axis [m], the thing closed.
        axis: Direction of opening: right-handed about it, or along it.
        limit: Widest opening [rad, m].
        friction, damping: As of `description.Joint`.
    """

    kind: Literal["hinge", "slide"]
    origin: tuple[Coordinate, Coordinate, Coordinate]
    axis: tuple[Coordinate, Coordinate, Coordinate]
    limit: Annotated[float, Field(gt=0, le=3.2)]
    friction: Annotated[float, Field(ge=0, le=10)] = 0.1
    damping: Annotated[float, Field(ge=0, le=100)] = 1.0


def mesh(
    *,
    file: str,
    scale: Annotated[float, Field(gt=0, le=1000)] = 1.0,
    joints: Mapping[str, MeshJoint] = {},
    volumes: tuple[Piece, ...] = (),
    grips: tuple[Piece, ...] = (),
) -> Description:
    """A mesh of one's own, from a file beside the catalogue's that `mpvi new object NAME --mesh FILE` makes.

    Physics takes its convex parts as they are; robots, goals and maps take each for the box around it. What it can hold
    are `volumes`, what it is taken by from above are `grips`: pieces that nobody sees.

    Raises:
        UserError: The file cannot be read, or its bodies are not those that the joints are of.
    """
    try:
        changed = Path(file).stat().st_mtime_ns
    except OSError as error:
        raise UserError(f"{file}: {(error.strerror or str(error)).lower()}") from None
    read = _read(file, changed)
    moving = [name for name in read if name != _ROOT]
    if _ROOT not in read or not read[_ROOT].hulls:
        raise UserError(f"{file}: has no convex part called {_ROOT}/hull")
    for name in joints:
        if name not in moving:
            raise UnknownName("body", name, moving, where=file)
    if lacking := [name for name in moving if name not in joints]:
        raise UserError(f"{file}: how {lacking[0]!r} moves must be said under joints")
    bodies = [_body(name, read[name], scale, joints.get(name)) for name in (_ROOT, *moving)]
    handles = tuple(piece.handle for piece in grips)
    root = RigidBody(_ROOT, bodies[0].parts, tuple(piece.solid for piece in volumes), handles, skin=bodies[0].skin)
    return Description((root, *bodies[1:]))


@lru_cache(maxsize=32)
def _read(file: str, changed: int) -> dict[str, MeshBody]:
    return read_mesh(file)


def _body(name: str, read: MeshBody, scale: float, given: MeshJoint | None) -> RigidBody:
    """One body, its parts in its own frame."""
    joint = None
    origin = np.zeros(3)
    if given is not None:
        axis = np.array(given.axis, float)
        length = float(norm(axis))
        if length < 1e-6:
            raise UserError(f"the axis of {name!r} has no direction")
        origin = np.array(given.origin, float) * scale
        limit = given.limit * (scale if given.kind == "slide" else 1.0)
        joint = Joint(given.kind, origin, axis / length, limit, given.friction, given.damping)
    color = read.skin[0].color if read.skin else _GRAY
    parts = tuple(_part(hull * scale - origin, color) for hull in read.hulls)
    skin = tuple(Skin(s.color, s.vertices * scale - origin, s.triangles) for s in read.skin)
    return RigidBody(name, parts, joint=joint, skin=skin)


def _part(corners: Array, color: tuple[float, float, float]) -> Part:
    low, high = corners.min(0), corners.max(0)
    middle = (low + high) / 2
    solid = box((float(middle[0]), float(middle[1]), float(middle[2])), tuple((high - low).tolist()))
    assert np.allclose(bounds([solid]), [low, high])
    return Part(solid, color, hull=corners)
