"""Meshes from elsewhere (GLB, OBJ, PLY, STL, URDF) made into files of ours: upright, in meters, with convex parts.

It is done once, when an entry of the catalogue is made, so that episodes need neither of the libraries that it takes.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.extras import install
from mpvi_bt.house.things.description import Skin
from mpvi_bt.house.things.mesh_file import MAX_HULLS, MeshBody, bounds_of
from mpvi_bt.house.things.mesh_parts import MESHES, ImportedMesh, convex_parts, joined, load, skins, stated_part
from mpvi_bt.house.things.mesh_urdf import read_urdf

SUFFIXES = (*MESHES, ".urdf")
_UNITS = {"millimeters": 0.001, "centimeters": 0.01, "inches": 0.0254}
_SMALLEST_M, _LARGEST_M = 0.005, 4.0  # Our choice: what stands in a room; outside of it the unit was another
_Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # what glTF and most OBJ files are
_UPRIGHT = (".ply", ".stl", ".urdf")  # of which z is up, mostly


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
        scale: Meters of one unit of the files.
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
        read_urdf(file, T, most, found)
    else:
        whole = load(file, T, found.remarks)
        hulls = [stated_part(load(part, T), part) for part in parts] or convex_parts(joined(whole), most, file)
        found.bodies["body"] = MeshBody(skins(whole, found.remarks), hulls)
    _stand(found)
    _check(found, file)
    return found


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
        why = guess if largest > _LARGEST_M else "is its unit larger than a meter? Give --scale."
        raise UserError(f"{file}: would be {largest:.3g} m large; {why}")
    if (count := sum(len(body.hulls) for body in found.bodies.values())) > MAX_HULLS:
        raise UserError(f"{file}: has {count} convex parts, more than {MAX_HULLS}.")


def volume_of(bodies: Mapping[str, MeshBody]) -> float:
    """Of all convex parts together [m^3]."""
    from scipy.spatial import ConvexHull

    return float(sum(ConvexHull(hull).volume for body in bodies.values() for hull in body.hulls))
