"""Mesh files of things: visual mesh of each body, and its convex collision parts.

The format is OBJ, which any viewer opens: of each body one object "BODY/skin", its triangles after `usemtl RRGGBB`,
and one "BODY/hull" for each convex part, of which only the vertices count. All of it in the frame of the thing [m].
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.house.things.description import Color, Skin

MAX_BYTES = 32 << 20
MAX_HULLS = 64  # of a thing: physics takes the time of a box for each
MAX_CORNERS = 255  # of a hull, which is what PhysX takes
_OBJECT = re.compile(r"([a-z][a-z0-9_]*)/(skin|hull)")
_COLOR = re.compile(r"[0-9a-f]{6}")


@dataclass
class MeshBody:
    """One body of a mesh.

    Attributes:
        skin: What is seen, by color.
        hulls: Corners of each convex part, (V, 3) [m].
    """

    skin: list[Skin] = field(default_factory=list)
    hulls: list[Array] = field(default_factory=list)


def read_mesh(path: str | Path) -> dict[str, MeshBody]:
    """The bodies of a mesh, by name.

    Raises:
        UserError: There is no such file, or it is none of ours; the line is named.
    """
    try:
        with Path(path).open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise UserError(f"{path}: {(error.strerror or str(error)).lower()}") from None
    if len(content) > MAX_BYTES:
        raise UserError(f"{path}: larger than {MAX_BYTES >> 20} MiB")
    bodies: dict[str, MeshBody] = {}
    vertices: list[list[float]] = []
    for piece in _objects(content.decode("utf-8", "replace"), path):
        piece.add_to(bodies, vertices, path)
    if not any(body.hulls for body in bodies.values()):
        raise UserError(f"{path}: has no convex parts; `mpvi new object NAME --mesh FILE` makes such a file")
    return bodies


def mesh_text(bodies: Mapping[str, MeshBody]) -> str:
    """The text that `read_mesh` reads."""
    lines, count = ["# a mesh of mpvi_bt: NAME/skin is what is seen, NAME/hull what collides [m]"], 0

    def add(vertices: Array) -> None:
        nonlocal count
        lines.extend("v " + " ".join(f"{x:.6g}" for x in vertex) for vertex in vertices)
        count += len(vertices)

    for name, body in bodies.items():
        if body.skin:
            lines.append(f"o {name}/skin")
        for skin in body.skin:
            first = count + 1
            add(skin.vertices)
            lines.append("usemtl " + "".join(f"{round(255 * channel):02x}" for channel in skin.color))
            lines += ["f " + " ".join(str(first + i) for i in triangle) for triangle in skin.triangles]
        for hull in body.hulls:
            lines.append(f"o {name}/hull")
            first = count + 1
            add(hull)
            lines += ["f " + " ".join(str(first + i) for i in triangle) for triangle in _faces(hull)]
    return "\n".join(lines) + "\n"


def _faces(hull: Array) -> NDArray[np.int32]:
    """Triangles of a hull, for viewers only."""
    from scipy.spatial import ConvexHull

    return ConvexHull(hull).simplices


@dataclass
class _Object:
    """One object of a file as it is read."""

    body: str
    kind: str
    line: int
    first: int  # of the file's vertices
    vertices: list[list[float]] = field(default_factory=list)
    triangles: dict[str, list[list[int]]] = field(default_factory=dict)

    def add_to(self, bodies: dict[str, MeshBody], vertices: list[list[float]], path: str | Path) -> None:
        """Put it into its body. Raises UserError."""
        vertices += self.vertices
        body = bodies.setdefault(self.body, MeshBody())
        corners = np.array(self.vertices, float).reshape(-1, 3)
        if self.kind == "hull":
            if not 4 <= len(corners) <= MAX_CORNERS or (np.ptp(corners, axis=0) <= 0).any():
                raise UserError(f"{path}:{self.line}: a hull has 4 to {MAX_CORNERS} corners, and is not flat")
            body.hulls.append(corners)
            return
        for material, triangles in self.triangles.items():
            used = np.array(triangles) - 1 - self.first
            if used.min() < 0 or used.max() >= len(corners):
                raise UserError(f"{path}:{self.line}: a triangle names a vertex that is not its object's")
            body.skin.append(Skin(_rgb(material), corners, used))


def _objects(text: str, path: str | Path) -> Iterator[_Object]:
    """The objects of a file, each once it is whole. Raises UserError."""
    current: _Object | None = None
    count, material = 0, ""
    for number, line in enumerate(text.splitlines(), start=1):
        word, _, rest = line.strip().partition(" ")
        try:
            if word == "o":
                if current is not None:
                    yield current
                if (named := _OBJECT.fullmatch(rest)) is None:
                    raise ValueError("an object is named BODY/skin or BODY/hull")
                current, material = _Object(named[1], named[2], number, count), ""
            elif word == "v" and current is not None:
                vertex = [float(x) for x in rest.split()]
                if len(vertex) != 3 or not np.isfinite(vertex).all():
                    raise ValueError("a vertex has three finite numbers")
                current.vertices.append(vertex)
                count += 1
            elif word == "usemtl":
                material = rest
                if not _COLOR.fullmatch(material):
                    raise ValueError("a material is a color, such as c8202c")
            elif word == "f" and current is not None:
                triangle = [int(x) for x in rest.split()]
                if len(triangle) != 3:
                    raise ValueError("a face is a triangle")
                current.triangles.setdefault(material or "808080", []).append(triangle)
            elif word and not word.startswith("#"):
                raise ValueError("expected o, v, usemtl or f; `mpvi new object NAME --mesh FILE` makes such a file")
        except ValueError as error:
            raise UserError(f"{path}:{number}: {error}") from None
    if current is not None:
        yield current


def _rgb(material: str) -> Color:
    r, g, b = (int(material[i : i + 2], 16) / 255 for i in (0, 2, 4))
    return (r, g, b)


def bounds_of(bodies: Iterable[MeshBody]) -> Array:
    """(2, 3) lowest and highest corner of all hulls."""
    corners = np.concatenate([hull for body in bodies for hull in body.hulls])
    return np.stack([corners.min(0), corners.max(0)])
