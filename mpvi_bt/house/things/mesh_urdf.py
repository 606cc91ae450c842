"""Things from a URDF: one fixed body, with others that turn or slide on it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.house.things.mesh_colors import named_picture
from mpvi_bt.house.things.mesh_file import MeshBody
from mpvi_bt.house.things.mesh_parts import ImportedMesh, convex_parts, load, skins

if TYPE_CHECKING:
    import trimesh

_KINDS = {"revolute": "hinge", "prismatic": "slide"}


def read_urdf(file: Path, T: Array, most: int, found: ImportedMesh) -> None:
    """Put the bodies and joints of a URDF into `found`.

    Args:
        file: The URDF; its meshes lie where it says, or below one of the folders above it.
        T: (4, 4) its frame and unit to ours.
        most: Convex parts of each collision mesh at most.
        found: Is filled in.

    Raises:
        UserError: It is no URDF, a file of it is missing, or its joints are other ones than things have.
    """
    urdf = _parsed(file)
    at = {urdf.base_link.name: ("body", T)}  # link to the body that it is part of, and its pose, all joints at 0
    found.bodies["body"] = MeshBody()
    waiting = list(urdf.joints)
    while waiting:
        ready = next((joint for joint in waiting if joint.parent in at), None)
        if ready is None:
            raise UserError(f"{file}: joint {waiting[0].name!r} hangs on no link.")
        waiting.remove(ready)
        body, above = at[ready.parent]
        frame = matmul(above, np.asarray(ready.origin, float))
        if ready.joint_type in _KINDS:
            if body != "body":
                raise UserError(
                    f"{file}: joint {ready.name!r} hangs on {body!r}, which moves itself: one level is known."
                )
            body = _name(ready.child, found)
            found.bodies[body] = MeshBody()
            found.joints[body] = _joint(ready, frame, T, file)
        elif ready.joint_type != "fixed":
            found.remarks.append(f"joint {ready.name!r} ({ready.joint_type}) is taken as fixed")
        at[ready.child] = (body, frame)
    for link in urdf.links:
        if link.name not in at:
            raise UserError(f"{file}: link {link.name!r} hangs on no joint.")
        name, frame = at[link.name]
        moved = found.bodies[name]
        seen = [mesh for visual in link.visuals for mesh in _painted(visual, frame, file, found.remarks)]
        moved.skin += skins(seen, found.remarks) if seen else []
        for collision in link.collisions:
            for mesh in _meshes(collision, frame, file):
                moved.hulls += convex_parts(mesh, most, file)
    for name, made in found.bodies.items():
        if not made.hulls:
            raise UserError(f"{file}: {name!r} has nothing that collides.")


def _parsed(file: Path) -> Any:
    from sapien.wrapper.urchin import URDF

    if not file.is_file():
        raise UserError(f"{file}: there is no such file.")
    try:
        return URDF.load(str(file), lazy_load_meshes=True)
    except Exception as error:  # whatever a broken file makes of the reader
        told = " ".join(str(error).split())[:200] or type(error).__name__
        raise UserError(f"{file}: cannot be read as URDF: {told}") from None


def _name(link: str, found: ImportedMesh) -> str:
    name = re.sub(r"[^a-z0-9_]+", "_", link.lower()).strip("_")
    name = name if name[:1].isalpha() else f"part_{name}"
    return name if name not in found.bodies else f"{name}_{len(found.bodies)}"


def _joint(joint: Any, frame: Array, T: Array, file: Path) -> dict[str, Any]:
    """As of `scanned.MeshJoint`, its axis the way that opens. Raises UserError."""
    limit = joint.limit
    low, high = (float(limit.lower or 0.0), float(limit.upper or 0.0)) if limit else (0.0, 0.0)
    if min(abs(low), abs(high)) > 1e-3 or low == high:
        raise UserError(f"{file}: joint {joint.name!r} goes from {low:g} to {high:g}; a thing is closed at 0, one end.")
    axis = matmul(frame[:3, :3], np.asarray(joint.axis, float)) * (1 if high > -low else -1)
    scale = float(norm(T[:3, 0]))
    kind = _KINDS[joint.joint_type]
    reach = max(high, -low) * (scale if kind == "slide" else 1.0)
    return {
        "kind": kind,
        "origin": frame[:3, 3].tolist(),
        "axis": [round(float(x), 6) + 0.0 for x in axis / norm(axis)],
        "limit": round(reach, 6),
    }


def _painted(visual: Any, frame: Array, file: Path, remarks: list[str]) -> list[trimesh.Trimesh]:
    """The meshes of a visual, in our frame, with the material that the URDF gives it, or else their own."""
    import trimesh

    visuals: Any = trimesh.visual  # has no types
    found = _meshes(visual, frame, file, remarks)
    material = visual.material
    texture = material.texture.filename if material is not None and material.texture is not None else ""
    if material is None or (material.color is None and not texture):
        return found
    image = named_picture(texture, _file(texture, file), file, remarks) if texture else None
    for mesh in found:
        paint = visuals.material.PBRMaterial(name=material.name, baseColorFactor=material.color, baseColorTexture=image)
        mesh.visual = visuals.TextureVisuals(uv=getattr(mesh.visual, "uv", None), material=paint)
    return found


def _meshes(shape: Any, frame: Array, file: Path, remarks: list[str] | None = None) -> list[trimesh.Trimesh]:
    """The meshes of a visual or a collision, in our frame; of a mesh whose colors matter, remarks are added."""
    import trimesh

    T = matmul(frame, np.asarray(shape.origin, float))
    geometry = shape.geometry
    if geometry.mesh is not None:
        size = np.ones(3) if geometry.mesh.scale is None else np.asarray(geometry.mesh.scale, float)
        path = _file(geometry.mesh.filename, file)
        if path is None:
            raise UserError(
                f"{file}: names {geometry.mesh.filename}, and there is no such file in its folder or above."
            )
        found = load(path, matmul(T, np.diag([*size, 1.0])), remarks)
    else:
        if geometry.box is not None:
            made = trimesh.creation.box(np.asarray(geometry.box.size, float))
        elif geometry.cylinder is not None:
            made = trimesh.creation.cylinder(geometry.cylinder.radius, geometry.cylinder.length, sections=24)
        elif geometry.sphere is not None:
            made = trimesh.creation.icosphere(subdivisions=2, radius=geometry.sphere.radius)
        else:
            raise UserError(f"{file}: a geometry is a box, a cylinder, a sphere or a mesh.")
        made.apply_transform(T)
        found = [made]
    return found


def _file(given: str, urdf: Path) -> Path | None:
    """A file that a URDF names: from its own folder, or, of a package, from one above it; None: there is none."""
    name = given.removeprefix("package://").removeprefix("file://")
    for folder in (urdf.parent, *urdf.parent.resolve().parents):
        if (folder / name).is_file():
            return folder / name
    return None
