"""Colors of imported meshes: of materials, textures, both, vertices, MTL and URDF; what is missing is told."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

trimesh = pytest.importorskip("trimesh", reason="needs the extra mesh")
pytest.importorskip("coacd", reason="needs the extra mesh")
from PIL import Image  # noqa: E402
from trimesh.visual import TextureVisuals  # noqa: E402
from trimesh.visual.material import PBRMaterial  # noqa: E402

from mpvi_bt.house.things.mesh_import import import_mesh  # noqa: E402
from mpvi_bt.house.things.mesh_parts import ImportedMesh  # noqa: E402

RED = (230, 25, 25)
GRAY = (153, 153, 153)


def colors(made: ImportedMesh) -> set[tuple[int, ...]]:
    """Those that a camera sees, in bytes."""
    return {tuple(round(255 * c) for c in skin.color) for body in made.bodies.values() for skin in body.skin}


def picture(path: Path, color: tuple[int, int, int] = RED) -> Image.Image:
    """A picture of one color, kept as a file."""
    made = Image.new("RGB", (8, 8), color)
    made.save(path)
    return made


def cube(material: Any = None, uv: bool = True) -> Any:
    """A cube with a material, and with texture coordinates if it is to have them."""
    made = trimesh.creation.box((0.1, 0.1, 0.1))
    if material is not None:
        made.visual = TextureVisuals(uv=np.full((8, 2), 0.5) if uv else None, material=material)
    return made


@pytest.mark.parametrize("uv", [False, True])
def test_the_factor_of_a_glb_material_is_its_color(uv: bool, tmp_path: Path) -> None:
    """With texture coordinates and without."""
    cube(PBRMaterial(baseColorFactor=[0.9, 0.1, 0.1, 1.0]), uv).export(tmp_path / "a.glb")
    made = import_mesh(tmp_path / "a.glb")
    assert colors(made) == {(230, 26, 26)}
    assert made.remarks == []


def test_texture_and_factor_of_a_glb_are_multiplied(tmp_path: Path) -> None:
    """A white texture under a factor is the factor, a texture without one is itself, half of it is darker."""
    red = picture(tmp_path / "red.png")
    for factor, seen in ((None, RED), ([1.0, 1.0, 1.0, 1.0], RED), ([0.502, 1.0, 1.0, 1.0], (115, 25, 25))):
        cube(PBRMaterial(baseColorFactor=factor, baseColorTexture=red)).export(tmp_path / "a.glb")
        (found,) = colors(import_mesh(tmp_path / "a.glb"))
        assert np.abs(np.subtract(found, seen)).max() <= 1


def test_each_triangle_has_the_color_of_its_part_of_the_texture(tmp_path: Path) -> None:
    """The top of an OBJ is green, its other sides are red, by one texture of two halves."""
    halves = Image.new("RGB", (8, 8), RED)
    halves.paste((0, 200, 0), (0, 0, 8, 4))  # the upper half, v from 0.5 to 1
    halves.save(tmp_path / "halves.png")
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd halves.png\n")
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    lines = ["mtllib a.mtl", "usemtl m", "vt 0.5 0.25", "vt 0.5 0.75"]
    lines += ["v " + " ".join(map(str, vertex)) for vertex in box.vertices]
    for face, normal in zip(box.faces, box.face_normals, strict=True):
        lines.append("f " + " ".join(f"{i + 1}/{2 if normal[1] > 0.5 else 1}" for i in face))  # y of an OBJ is up
    (tmp_path / "a.obj").write_text("\n".join(lines) + "\n")
    made = import_mesh(tmp_path / "a.obj")
    assert colors(made) == {RED, (0, 200, 0)}
    (green,) = (skin for skin in made.bodies["body"].skin if skin.color[1] > 0.5)
    assert (green.vertices[:, 2] > 0.099).all()


MTL = {
    "Kd 0.9 0.1 0.1": ({(230, 26, 26)}, ""),
    "map_Kd red.png": ({RED}, ""),
    "Kd 1 1 1\nmap_Kd red.png": ({RED}, ""),
    "map_Kd .\\red.png": ({RED}, ""),
    "map_Kd ../sub/red.png": ({RED}, ""),
    "map_Kd -s 1 1 1 -clamp on red.png": ({RED}, ""),
    "map_Kd -s 2 2 2 red.png": ({RED}, "-s 2 2 2 of a texture is not applied"),
    "map_Kd röd färg.png": ({RED}, ""),
    "Kd 0.9 0.1 0.1\nmap_Kd gone.png": ({(230, 26, 26)}, "names 'gone.png', and no such file can be read"),
    "map_Kd gone.png": ({GRAY}, "names 'gone.png', and no such file can be read"),
    "map_Kd words.png": ({GRAY}, "words.png: cannot be read as a picture"),
    "Kd 0.9 0.1 0.1\nd 0.3": ({(230, 26, 26)}, "is transparent: it is drawn opaque"),
    "Ns 10": ({GRAY}, "material 'm' has no color: what it covers is gray"),
}


@pytest.mark.parametrize("text", list(MTL))
def test_materials_of_an_mtl_file_give_colors_or_a_remark(text: str, tmp_path: Path) -> None:
    """What is missing, not read or not applied is told, with the file's name; and nothing else is told."""
    seen, said = MTL[text]
    folder = tmp_path / "sub"
    folder.mkdir()
    for name in ("red.png", "röd färg.png"):
        picture(folder / name)
    (folder / "words.png").write_text("no picture")
    (folder / "m.mtl").write_text(f"newmtl m\n{text}\n")
    box = cube()
    lines = ["mtllib m.mtl", "usemtl m", "vt 0.5 0.5"] + ["v " + " ".join(map(str, v)) for v in box.vertices]
    lines += ["f " + " ".join(f"{i + 1}/1" for i in face) for face in box.faces]
    (folder / "a.obj").write_text("\n".join(lines) + "\n")
    made = import_mesh(folder / "a.obj")
    assert colors(made) == seen
    assert said in "\n".join(made.remarks)
    assert bool(said) == bool(made.remarks)


def test_a_mesh_without_a_color_is_gray_and_says_so(tmp_path: Path) -> None:
    """So does one whose MTL file is missing, which is named."""
    cube().export(tmp_path / "a.stl")
    made = import_mesh(tmp_path / "a.stl")
    assert (colors(made), made.remarks) == ({GRAY}, ["no color is given for some of its triangles: they are gray"])
    cube().export(tmp_path / "a.obj")
    (tmp_path / "a.obj").write_text("mtllib gone.mtl\n" + (tmp_path / "a.obj").read_text())
    assert "a.obj: names 'gone.mtl', and no such file can be read" in import_mesh(tmp_path / "a.obj").remarks[0]


def test_an_extension_that_changes_colors_and_is_not_read_is_told(tmp_path: Path) -> None:
    """Such as textures in KTX2, which leave the factor alone to see."""
    cube(PBRMaterial(baseColorFactor=[0.9, 0.1, 0.1, 1.0])).export(tmp_path / "a.glb")
    content = (tmp_path / "a.glb").read_bytes()
    length = struct.unpack_from("<I", content, 12)[0]
    header = json.loads(content[20 : 20 + length]) | {"extensionsUsed": ["KHR_texture_basisu"]}
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    rest = content[20 + length :]
    whole = 12 + 8 + len(text) + len(rest)
    (tmp_path / "a.glb").write_bytes(b"glTF" + struct.pack("<III", 2, whole, len(text)) + b"JSON" + text + rest)
    assert import_mesh(tmp_path / "a.glb").remarks == ["a.glb: textures in KTX2 are not read (KHR_texture_basisu)"]


URDF = """
<robot name="box">
  <material name="red"><color rgba="0.9 0.1 0.1 1"/></material>
  <link name="base">
    <visual><geometry>{geometry}</geometry><material name="{name}">{material}</material></visual>
    <collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>
  </link>
</robot>
"""
BOX = '<box size="0.1 0.1 0.1"/>'
PAINTED = '<mesh filename="package://thing/painted.glb"/>'


@pytest.mark.parametrize(
    ("geometry", "name", "material", "seen", "said"),
    [
        (BOX, "red", "", (230, 26, 26), ""),
        (BOX, "own", '<color rgba="0.9 0.1 0.1 1"/>', (230, 26, 26), ""),
        (BOX, "own", '<color rgba="0.9 0.1 0.1 0.2"/>', (230, 26, 26), "is transparent"),
        (BOX, "own", '<texture filename="package://thing/red.png"/>', RED, "its mean color is taken"),
        (PAINTED, "own", '<color rgba="0 0 1 1"/>', (0, 0, 255), ""),
        (PAINTED, "own", '<texture filename=""/>', RED, ""),
        (PAINTED, "own", '<texture filename="gone.png"/>', GRAY, "names 'gone.png', and no such file can be read"),
    ],
)
def test_a_urdf_gives_its_materials_colors(
    geometry: str, name: str, material: str, seen: tuple[int, ...], said: str, tmp_path: Path
) -> None:
    """Before those of its meshes: by name, color or texture."""
    (tmp_path / "thing").mkdir()
    red = picture(tmp_path / "thing" / "red.png")
    cube(PBRMaterial(baseColorTexture=red)).export(tmp_path / "thing" / "painted.glb")
    (tmp_path / "a.urdf").write_text(URDF.format(geometry=geometry, name=name, material=material))
    made = import_mesh(tmp_path / "a.urdf")
    assert len(colors(made)) == 1
    assert np.abs(np.subtract(next(iter(colors(made))), seen)).max() <= 1
    assert said in "\n".join(made.remarks)
    assert bool(said) == bool(made.remarks)


@given(st.lists(st.tuples(st.integers(0, 255), st.integers(0, 255), st.integers(0, 255)), min_size=1, max_size=3))
def test_colors_of_faces_come_through_to_the_byte(palette: list[tuple[int, int, int]]) -> None:
    """Whatever they are."""
    from mpvi_bt.house.things.mesh_parts import skins

    meshes = []
    for color in palette:
        made = cube()
        made.visual.face_colors = [*color, 255]
        meshes.append(made)
    remarks: list[str] = []
    found = {tuple(round(255 * c) for c in skin.color) for skin in skins(meshes, remarks)}
    assert (found, remarks) == (set(palette), [])
