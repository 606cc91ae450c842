"""Meshes as files have them: what is seen of them, and the convex parts that collide."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.house.things.description import Color, Skin
from mpvi_bt.house.things.mesh_colors import NamedFiles, face_colors, unread_extensions
from mpvi_bt.house.things.mesh_file import MAX_CORNERS, MeshBody

if TYPE_CHECKING:
    import trimesh

MESHES = (".glb", ".gltf", ".obj", ".ply", ".stl")
MAX_TRIANGLES = 50_000  # Our choice: a camera's picture on a CPU costs by them
_COLORS = 12  # of a skin at most: each is a shape to draw
_CONVEX = 0.97  # share of its hull's volume that a part fills which counts as convex
_CONCAVITY = 0.05  # coacd's default: how far parts may be from convex
_HULL_CORNERS = 64  # of a computed part
_SEED = 0


@dataclass
class ImportedMesh:
    """A mesh made ours.

    Attributes:
        bodies: By name, "body" among them.
        joints: How the others move, as of `scanned.MeshJoint`.
        remarks: What was done that one might not expect.
    """

    bodies: dict[str, MeshBody]
    joints: dict[str, dict[str, Any]] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)


def load(file: Path, T: Array, remarks: list[str] | None = None) -> list[trimesh.Trimesh]:
    """The meshes of a file.

    Args:
        file: Of one of the formats of `MESHES`.
        T: (4, 4) its frame and unit to ours.
        remarks: What it names and lacks is added; None: its colors do not matter.

    Raises:
        UserError: It is not there, cannot be read, has no triangles or too many.
    """
    import trimesh

    if not file.is_file():
        raise UserError(f"{file}: there is no such file.")
    named = NamedFiles(file)
    resolver: Any = named  # trimesh asks of it no more than `get`
    try:
        scene = trimesh.load_scene(file, resolver=resolver)
        meshes = [m for m in scene.dump() if isinstance(m, trimesh.Trimesh) and len(m.faces)]
        named.remarks += unread_extensions(file)
    except Exception as error:  # trimesh's readers raise whatever a broken file makes of them; the cause is told
        told = " ".join(str(error).split())[:200] or type(error).__name__
        raise UserError(f"{file}: cannot be read as {file.suffix[1:].upper()}: {told}") from None
    if remarks is not None:
        remarks += [remark for remark in named.remarks if remark not in remarks]
    if not meshes:
        raise UserError(f"{file}: has no triangles.")
    for mesh in meshes:
        if not np.isfinite(mesh.vertices).all():
            raise UserError(f"{file}: has corners that are no finite numbers.")
        mesh.apply_transform(T)
    if (count := sum(len(mesh.faces) for mesh in meshes)) > MAX_TRIANGLES:
        raise UserError(f"{file}: has {count} triangles, more than {MAX_TRIANGLES}; decimate it in a mesh editor.")
    return meshes


def skins(meshes: Sequence[trimesh.Trimesh], remarks: list[str]) -> list[Skin]:
    """What is seen of meshes: their triangles by color, a dozen colors at most. Remarks are added to `remarks`."""
    corners = np.concatenate([mesh.triangles for mesh in meshes])
    colors = np.concatenate([face_colors(mesh, remarks) for mesh in meshes])
    labels, palette = _grouped(colors)
    found = []
    for k, color in enumerate(palette):
        own = corners[labels == k]
        if len(own):
            vertices, index = np.unique(own.reshape(-1, 3).round(6), axis=0, return_inverse=True)
            found.append(Skin(color, vertices, index.reshape(-1, 3)))
    return found


def _grouped(colors: Array) -> tuple[NDArray[np.intp], list[Color]]:
    """Which of a few colors each triangle has, and these."""
    from scipy.cluster.vq import kmeans2

    kinds, index = np.unique((colors * 255).round().astype(int), axis=0, return_inverse=True)
    if len(kinds) > _COLORS:
        centers, labels = kmeans2(kinds.astype(float), _COLORS, minit="++", seed=_SEED)
        index, kinds = labels[index], centers.round().astype(int)
    return index.reshape(-1).astype(np.intp), [(float(r) / 255, float(g) / 255, float(b) / 255) for r, g, b in kinds]


def joined(meshes: Sequence[trimesh.Trimesh]) -> trimesh.Trimesh:
    """One mesh of several."""
    import trimesh

    joined = trimesh.Trimesh(*_arrays(meshes), process=True)
    joined.merge_vertices()
    return joined


def _arrays(meshes: Sequence[trimesh.Trimesh]) -> tuple[Array, Any]:
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    return (
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]),
    )


def convex_parts(mesh: trimesh.Trimesh, most: int, file: Path) -> list[Array]:
    """Corners of convex parts that together are about the mesh.

    What is in closed pieces is taken piece by piece: where coacd has to close something first it takes minutes.

    Raises:
        UserError: It has no volume, or coacd makes nothing of it.
    """
    _hull(mesh.vertices, file)
    pieces = mesh.split(only_watertight=False)
    if not (len(pieces) <= most and all(piece.is_watertight for piece in pieces)):
        pieces = [mesh]
    bent = [piece for piece in pieces if not _convex(piece, file)]
    parts = [np.asarray(_hull(piece.vertices, file).vertices, float) for piece in pieces if _convex(piece, file)]
    for piece in bent:
        parts += _decomposed(piece, max(1, (most - (len(pieces) - len(bent))) // len(bent)), file)
    return parts


def _convex(piece: trimesh.Trimesh, file: Path) -> bool:
    """Whether it is its own hull, with no more corners than a part may have."""
    hull = _hull(piece.vertices, file)
    return bool(piece.is_watertight and piece.volume > _CONVEX * hull.volume and len(hull.vertices) <= MAX_CORNERS)


def _decomposed(mesh: trimesh.Trimesh, most: int, file: Path) -> list[Array]:
    """By coacd, in a process of its own: what it makes of a broken mesh may end it."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        try:
            found = pool.submit(decompose, np.asarray(mesh.vertices), np.asarray(mesh.faces), most).result()
        except BrokenProcessPool:
            raise UserError(f"{file}: coacd breaks down on it; mend the mesh, or give its convex parts.") from None
    parts = [np.asarray(_hull(vertices, file).vertices, float) for vertices in found if _solid(vertices)]
    if not parts:
        raise UserError(f"{file}: coacd finds no convex part in it; mend the mesh, or give its convex parts.")
    return parts


def decompose(vertices: Array, faces: Any, most: int) -> list[Array]:
    """Corners of convex parts, by coacd (Wei et al., Approximate Convex Decomposition ..., SIGGRAPH 2022)."""
    import coacd

    coacd.set_log_level("error")
    found = coacd.run_coacd(
        coacd.Mesh(vertices, faces), threshold=_CONCAVITY, max_convex_hull=most, decimate=True,
        max_ch_vertex=_HULL_CORNERS, seed=_SEED,
    )  # fmt: skip
    return [np.asarray(part[0], float) for part in found]


def _solid(vertices: Array) -> bool:
    return len(vertices) >= 4 and bool((np.ptp(vertices, axis=0) > 1e-5).all())


def _hull(vertices: Array, file: Path) -> trimesh.Trimesh:
    import trimesh
    from scipy.spatial import QhullError

    try:
        hull = trimesh.convex.convex_hull(np.asarray(vertices, float))
    except (QhullError, ValueError):  # it is flat, or has too few corners
        raise UserError(f"{file}: is flat, or a line: it has no volume to collide by.") from None
    if hull.volume <= 0:
        raise UserError(f"{file}: is flat, or a line: it has no volume to collide by.")
    return hull


def stated_part(meshes: Sequence[trimesh.Trimesh], file: Path) -> Array:
    """Corners of a part that is said to be convex. Raises UserError if it is not."""
    mesh = joined(meshes)
    hull = _hull(mesh.vertices, file)
    share = float(mesh.volume / hull.volume) if mesh.is_watertight else 1.0
    if share < _CONVEX:
        raise UserError(
            f"{file}: is not convex, but fills {share:.0%} of its hull. Give none, and convex parts are computed."
        )
    if len(hull.vertices) > MAX_CORNERS:
        raise UserError(f"{file}: has {len(hull.vertices)} corners; a convex part has {MAX_CORNERS} at most.")
    return np.asarray(hull.vertices, float)
