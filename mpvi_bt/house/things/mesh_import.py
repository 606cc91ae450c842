"""Meshes from elsewhere (GLB, OBJ, PLY, STL, URDF) made into files of ours: upright, in metres, with convex parts.

It is done once, when an entry of the catalogue is made, so that episodes need neither of the libraries that it takes.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.extras import install
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.house.things.description import Color, Skin
from mpvi_bt.house.things.mesh_colors import NamedFiles, face_colors, unread_extensions
from mpvi_bt.house.things.mesh_file import MAX_CORNERS, MAX_HULLS, MeshBody, bounds_of

if TYPE_CHECKING:
    import trimesh

MESHES = (".glb", ".gltf", ".obj", ".ply", ".stl")
SUFFIXES = (*MESHES, ".urdf")
MAX_TRIANGLES = 50_000  # Our choice: a camera's picture on a CPU costs by them
_UNITS = {"millimetres": 0.001, "centimetres": 0.01, "inches": 0.0254}
_SMALLEST_M, _LARGEST_M = 0.005, 4.0  # Our choice: what stands in a room; outside of it the unit was another
_COLORS = 12  # of a skin at most: each is a shape to draw
_CONVEX = 0.97  # share of its hull's volume that a part fills which counts as convex
_CONCAVITY = 0.05  # coacd's default: how far parts may be from convex
_HULL_CORNERS = 64  # of a computed part
_SEED = 0
_Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # what glTF and most OBJ files are
_UPRIGHT = (".ply", ".stl", ".urdf")  # of which z is up, mostly


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


def import_mesh(
    file: Path,
    parts: Sequence[Path] = (),
    scale: float = 1.0,
    up: Literal["y", "z"] | None = None,
    most: int = 16,
) -> ImportedMesh:
    """Read a mesh, or a thing of joined bodies, and give it convex parts.

    Args:
        file: What is seen; of a URDF, what collides too.
        parts: Files of its convex parts, in the same frame; none: they are computed.
        scale: Metres of one unit of the files.
        up: The axis that points up; None: as the format has it.
        most: Parts at most, where they are computed.

    Raises:
        UserError: A file is not there, is no mesh, is broken, of no size that a thing has, or too fine; a part is not
            convex; a URDF is of other joints than things have; or what it takes is not installed.
    """
    for library in ("trimesh", "coacd"):
        if importlib.util.find_spec(library) is None:
            raise UserError(f"meshes need {library}, which is not installed: {install('mesh')}")
    if not 1 <= most <= MAX_HULLS:
        raise UserError(f"{most} convex parts: from 1 to {MAX_HULLS} are possible.")
    suffix = file.suffix.lower()
    if suffix not in SUFFIXES:
        raise UserError(f"{file}: a mesh is one of {', '.join(SUFFIXES)}.")
    turn = _Y_UP if (up or ("z" if suffix in _UPRIGHT else "y")) == "y" else np.eye(4)
    T = turn * np.array([scale] * 3 + [1.0])[None, :]  # columns: scaled, then turned
    found = ImportedMesh({})
    if suffix == ".urdf":
        if parts:
            raise UserError(f"{file}: a URDF says itself what collides; parts cannot be given beside it.")
        from mpvi_bt.house.things.mesh_urdf import read_urdf

        read_urdf(file, T, most, found)
    else:
        whole = load(file, T, found.remarks)
        hulls = [_given(load(part, T), part) for part in parts] or convex_parts(_joined(whole), most, file)
        found.bodies["body"] = MeshBody(skins(whole, found.remarks), hulls)
    _stand(found)
    _check(found, file)
    return found


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


def _joined(meshes: Sequence[trimesh.Trimesh]) -> trimesh.Trimesh:
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


def _given(meshes: Sequence[trimesh.Trimesh], file: Path) -> Array:
    """Corners of a part that is said to be convex. Raises UserError if it is not."""
    mesh = _joined(meshes)
    hull = _hull(mesh.vertices, file)
    share = float(mesh.volume / hull.volume) if mesh.is_watertight else 1.0
    if share < _CONVEX:
        raise UserError(
            f"{file}: is not convex, but fills {share:.0%} of its hull. Give none, and convex parts are computed."
        )
    if len(hull.vertices) > MAX_CORNERS:
        raise UserError(f"{file}: has {len(hull.vertices)} corners; a convex part has {MAX_CORNERS} at most.")
    return np.asarray(hull.vertices, float)


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


def _stand(found: ImportedMesh) -> None:
    """Put it on z = 0, its middle over the origin."""
    low, high = bounds_of(found.bodies.values())
    shift = np.array([-(low[0] + high[0]) / 2, -(low[1] + high[1]) / 2, -low[2]])
    for body in found.bodies.values():
        body.hulls = [hull + shift for hull in body.hulls]
        body.skin = [Skin(s.color, s.vertices + shift, s.triangles) for s in body.skin]
    for joint in found.joints.values():
        joint["origin"] = [round(float(x), 6) for x in np.array(joint["origin"]) + shift]


def _check(found: ImportedMesh, file: Path) -> None:
    """Raises UserError if it is of no size that a thing has, or of too many parts."""
    low, high = bounds_of(found.bodies.values())
    largest = float((high - low).max())
    if not _SMALLEST_M <= largest <= _LARGEST_M:
        sizes = {unit: (largest * scale, scale) for unit, scale in _UNITS.items()}
        units = [
            f"{unit}: --scale {s:g} ({m:.3g} m)" for unit, (m, s) in sizes.items() if _SMALLEST_M <= m <= _LARGEST_M
        ]
        guess = f"is it in {' or '.join(units)}?" if units else "give --scale."
        why = guess if largest > _LARGEST_M else "is its unit larger than a metre? Give --scale."
        raise UserError(f"{file}: would be {largest:.3g} m large; {why}")
    if (count := sum(len(body.hulls) for body in found.bodies.values())) > MAX_HULLS:
        raise UserError(f"{file}: has {count} convex parts, more than {MAX_HULLS}.")


def volume_of(bodies: Mapping[str, MeshBody]) -> float:
    """Of all convex parts together [m^3]."""
    from scipy.spatial import ConvexHull

    return float(sum(ConvexHull(hull).volume for body in bodies.values() for hull in body.hulls))
