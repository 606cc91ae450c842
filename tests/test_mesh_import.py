"""Meshes of one's own: what becomes of GLB, OBJ, STL and URDF, and what is refused."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mpvi_bt
from mpvi_bt.apps.authoring.skeletons import new_mesh
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry.solids import pose
from mpvi_bt.house.sim.world import Placement
from mpvi_bt.house.things.catalogue import load_catalogue
from mpvi_bt.house.things.description import Skin
from mpvi_bt.house.things.mesh_file import MeshBody, bounds_of, mesh_text, read_mesh
from mpvi_bt.runs.suite.manifest import entry_content
from tests.small_house import placed, small_world

trimesh = pytest.importorskip("trimesh", reason="needs the extra mesh")
pytest.importorskip("coacd", reason="needs the extra mesh")
from mpvi_bt.house.things.mesh_import import import_mesh  # noqa: E402

CUBE = np.array([[x, y, z] for x in (0.0, 1) for y in (0.0, 1) for z in (0.0, 1)])


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of one's own, which is found and is the current one."""
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def block(size: tuple[float, float, float], at: tuple[float, float, float] = (0, 0, 0), color: Any = None) -> Any:
    made = trimesh.creation.box(size)
    made.apply_translation(at)
    if color is not None:
        made.visual.face_colors = color
    return made


@given(
    sizes=st.lists(st.floats(0.01, 2.0), min_size=1, max_size=3),
    color=st.tuples(*[st.integers(0, 255)] * 3),
)
def test_a_mesh_of_ours_reads_back_as_it_was_written(sizes: list[float], color: tuple[int, int, int]) -> None:
    """Colors to the byte, corners to a hundredth of a millimeter."""
    rgb = (color[0] / 255, color[1] / 255, color[2] / 255)
    hulls = [CUBE * size + i for i, size in enumerate(sizes)]
    skin = Skin(rgb, CUBE, np.array([[0, 1, 2], [1, 2, 3]]))
    path = Path("/dev/shm/mpvi_mesh_test.obj") if Path("/dev/shm").is_dir() else Path("mpvi_mesh_test.obj")
    try:
        path.write_text(mesh_text({"body": MeshBody([skin], hulls), "lid": MeshBody([skin], hulls)}))
        read = read_mesh(path)
    finally:
        path.unlink(missing_ok=True)
    assert list(read) == ["body", "lid"]
    for body in read.values():
        np.testing.assert_allclose(np.concatenate(body.hulls), np.concatenate(hulls), atol=1e-5)
        assert body.skin[0].color == pytest.approx(rgb)
        np.testing.assert_array_equal(body.skin[0].triangles, skin.triangles)


def test_a_glb_stands_upright_in_meters_and_in_its_colors(tmp_path: Path) -> None:
    """Its y is up; its pieces keep where they are to one another; the middle is over the origin."""
    scene = trimesh.Scene(
        [block((20, 40, 10), color=[200, 30, 40, 255]), block((10, 10, 10), (0, 25, 0), [0, 0, 250, 255])]
    )
    scene.export(tmp_path / "gnome.glb")
    made = import_mesh(tmp_path / "gnome.glb", scale=0.01)
    low, high = bounds_of(made.bodies.values())
    np.testing.assert_allclose([low, high], [[-0.1, -0.05, 0.0], [0.1, 0.05, 0.5]], atol=1e-6)
    assert len(made.bodies["body"].hulls) == 2
    assert sorted(tuple(round(255 * c) for c in skin.color) for skin in made.bodies["body"].skin) == [
        (0, 0, 250),
        (200, 30, 40),
    ]


@pytest.mark.parametrize(("name", "up", "height"), [("a.stl", None, 0.3), ("a.obj", None, 0.2), ("a.obj", "z", 0.3)])
def test_which_axis_is_up_depends_on_the_format(name: str, up: Any, height: float, tmp_path: Path) -> None:
    """And can be said."""
    block((0.1, 0.2, 0.3)).export(tmp_path / name)
    low, high = bounds_of(import_mesh(tmp_path / name, up=up).bodies.values())
    assert high[2] - low[2] == pytest.approx(height)


def broken(folder: Path, what: str) -> Path:
    """A file that is no mesh of a thing."""
    path = folder / f"{what}.obj"
    if what == "empty":
        path.write_text("")
    elif what == "words":
        path.write_text("v one two three\nf 1 2 3\n")
    elif what == "nan":
        path.write_text("v nan 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 2 3 4\n")
    elif what == "flat":
        path.write_text("v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0.1 0.1 0\nf 1 2 3\nf 2 3 4\n")
    elif what == "fine":
        trimesh.creation.icosphere(subdivisions=6, radius=0.1).export(path)
    elif what == "binary":
        path = folder / "binary.glb"
        path.write_bytes(b"\x00\x01" * 500)
    else:
        block((200.0, 100, 100)).export(path)
    return path


@pytest.mark.parametrize(
    ("what", "said"),
    [
        ("empty", "cannot be read as OBJ|has no triangles"),
        ("words", "cannot be read as OBJ|has no triangles"),
        ("binary", "cannot be read as GLB"),
        ("nan", "no finite numbers|cannot be read|flat"),
        ("flat", "is flat, or a line"),
        ("fine", "81920 triangles, more than 50000"),
        ("huge", r"in millimeters: --scale 0.001 \(0.2 m\) or centimeters: --scale 0.01 \(2 m\)\?"),
    ],
)
def test_what_is_no_mesh_of_a_thing_is_refused(what: str, said: str, tmp_path: Path) -> None:
    """With the file, the cause and what would do."""
    path = broken(tmp_path, what)
    with pytest.raises(UserError, match=said) as caught:
        import_mesh(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_files_that_are_not_there_or_not_known_are_told(tmp_path: Path) -> None:
    """And so is a part that is not convex."""
    with pytest.raises(UserError, match="there is no such file"):
        import_mesh(tmp_path / "no.glb")
    with pytest.raises(UserError, match="a mesh is one of"):
        import_mesh(tmp_path / "no.fbx")
    block((0.1, 0.1, 0.1)).export(tmp_path / "a.stl")
    trimesh.creation.annulus(0.02, 0.05, 0.1).export(tmp_path / "ring.stl")
    with pytest.raises(UserError, match=r"ring.stl: is not convex, but fills \d\d% of its hull"):
        import_mesh(tmp_path / "a.stl", [tmp_path / "ring.stl"])


def tray(folder: Path) -> tuple[Path, list[Path]]:
    """An open box, and the files of its bottom and walls."""
    pieces = [
        block((0.3, 0.2, 0.01)),
        *(block((0.01, 0.2, 0.08), (x, 0, 0.045)) for x in (-0.145, 0.145)),
        *(block((0.28, 0.01, 0.08), (0, y, 0.045)) for y in (-0.095, 0.095)),
    ]
    parts = [folder / f"part{i}.stl" for i in range(len(pieces))]
    for piece, path in zip(pieces, parts, strict=True):
        piece.export(path)
    trimesh.util.concatenate(pieces).export(folder / "tray.stl")
    return folder / "tray.stl", parts


def test_given_parts_are_what_collides(root: Path) -> None:
    """A ball that is dropped into a hollow mesh lies in it, which in its hull it could not."""
    file, parts = tray(root)
    new_mesh("quite_new", file, parts, synset="tray.n.01").write(root)
    entry = load_catalogue()["quite_new"]
    world = small_world(
        {"tray": Placement(entry, pose((1.0, 0.0, 0.0))), "ball": placed("tennis_ball", 1.05, 0.02, 0.2)}, (-2.0, 0, 0)
    )
    world.settle(2.0)
    x, y, z = world.pose("ball")[:3, 3]
    assert abs(x - 1.0) < 0.15
    assert abs(y) < 0.1
    assert z < 0.02
    low, high = entry.description.extent()
    np.testing.assert_allclose(high - low, [0.3, 0.2, 0.09], atol=1e-6)


LID = """
<robot name="chest">
  <link name="base">
    <visual>
      <geometry><box size="0.3 0.4 0.2"/></geometry>
      <material name="m"><color rgba="0.5 0.3 0.1 1"/></material>
    </visual>
    <collision><geometry><box size="0.3 0.4 0.2"/></geometry></collision>
  </link>
  <link name="Lid">
    <collision><origin xyz="0.15 0 0.01"/><geometry><box size="0.3 0.4 0.02"/></geometry></collision>
  </link>
  <joint name="hinge" type="{kind}">
    <parent link="base"/><child link="Lid"/><origin xyz="-0.15 0 0.1"/><axis xyz="0 1 0"/>
    <limit lower="{low}" upper="{high}" effort="1" velocity="1"/>
  </joint>
</robot>
"""


def test_a_urdf_keeps_its_joints(root: Path) -> None:
    """A lid that opens to the negative side of its axis opens; it stands, and its color is kept."""
    (root / "chest.urdf").write_text(LID.format(kind="revolute", low=-1.5, high=0))
    new_mesh("quite_new", root / "chest.urdf", synset="toolbox.n.01").write(root)
    assert mpvi_bt.check(root / "tasks") == []
    entry = load_catalogue()["quite_new"]
    lid = next(body for body in entry.description.bodies if body.name == "lid")
    assert lid.joint is not None
    assert lid.joint.limit == 1.5
    np.testing.assert_allclose(lid.joint.axis, [0, -1, 0])
    np.testing.assert_allclose(lid.joint.origin, [-0.15, 0, 0.2])
    closed, open_ = (max(s.aabb()[1, 2] for s in entry.description.solids(openings={"lid": x})) for x in (0.0, 1.0))
    assert closed == pytest.approx(0.22)
    assert open_ > 0.45
    world = small_world({"chest": Placement(entry, pose((1.0, 0.0, 0.001)))}, (-2.0, 0, 0))
    world.settle(1.0)
    assert world.pose("chest")[2, 3] == pytest.approx(0.0, abs=0.005)
    assert list(world.joint_fractions("chest")) == [pytest.approx(0.0, abs=0.02)]


@pytest.mark.parametrize(
    ("kind", "low", "high", "said"),
    [("revolute", -1, 1, "goes from -1 to 1; a thing is closed at 0"), ("revolute", 0, 0, "goes from 0 to 0")],
)
def test_joints_that_things_have_not_are_told(kind: str, low: float, high: float, said: str, tmp_path: Path) -> None:
    """By name."""
    (tmp_path / "a.urdf").write_text(LID.format(kind=kind, low=low, high=high))
    with pytest.raises(UserError, match=said):
        import_mesh(tmp_path / "a.urdf")


def test_a_urdf_whose_mesh_is_missing_says_which(tmp_path: Path) -> None:
    """And what is no URDF at all is told too."""
    (tmp_path / "a.urdf").write_text(
        LID.format(kind="fixed", low=0, high=0).replace(
            '<box size="0.3 0.4 0.02"/>', '<mesh filename="package://chest/lid.stl"/>'
        )
    )
    with pytest.raises(UserError, match=r"names package://chest/lid.stl, and there is no such file"):
        import_mesh(tmp_path / "a.urdf")
    (tmp_path / "b.urdf").write_text("<html>")
    with pytest.raises(UserError, match="cannot be read as URDF"):
        import_mesh(tmp_path / "b.urdf")


def test_an_entry_whose_mesh_is_gone_or_spoilt_is_told_with_its_place(root: Path) -> None:
    """Where the catalogue names it, and which line of it."""
    file, parts = tray(root)
    catalogue, mesh = new_mesh("quite_new", file, parts, synset="tray.n.01").write(root)
    text = mesh.read_text()
    mesh.write_text(text.replace("\nv ", "\nv nan ", 1))
    (problem,) = mpvi_bt.check(catalogue)
    assert (problem.code, problem.line) == ("unreadable", 9)
    assert f"{mesh}:3: a vertex has three finite numbers" in problem.message
    mesh.unlink()
    assert [p.code for p in mpvi_bt.check(catalogue)] == ["unreadable"]


def test_results_are_of_what_is_in_a_mesh_not_of_where_it_is(root: Path) -> None:
    """A suite's manifest tells a mesh that was changed, and not one that was moved."""
    file, parts = tray(root)
    _, mesh = new_mesh("quite_new", file, parts, synset="tray.n.01").write(root)
    before = entry_content(load_catalogue()["quite_new"])
    assert str(root) not in str(before)
    mesh.write_text(mesh.read_text() + "# moved a little\n")
    assert entry_content(load_catalogue()["quite_new"]) != before


@pytest.mark.slow
def test_convex_parts_of_what_is_hollow_are_computed(tmp_path: Path) -> None:
    """A ring keeps its hole, and no more parts than asked for are made of it."""
    trimesh.creation.annulus(0.03, 0.05, 0.06, sections=24).export(tmp_path / "ring.stl")
    made = import_mesh(tmp_path / "ring.stl", most=12)
    hulls = made.bodies["body"].hulls
    assert 4 <= len(hulls) <= 12
    assert all(np.linalg.norm(hull[:, :2], axis=1).max() > 0.045 for hull in hulls)
    from mpvi_bt.house.things.mesh_import import volume_of

    assert volume_of(made.bodies) == pytest.approx(np.pi * (0.05**2 - 0.03**2) * 0.06, rel=0.15)


def test_a_unit_is_named_for_each_size_that_a_thing_may_have(tmp_path: Path) -> None:
    """Inches too; none is named by which it would still be too large or too small."""
    import trimesh

    trimesh.creation.box((12, 12, 12)).export(tmp_path / "box.stl")
    with pytest.raises(UserError) as caught:
        import_mesh(tmp_path / "box.stl")
    named = re.findall(r"(\w+): --scale", str(caught.value))
    assert named == ["millimeters", "centimeters", "inches"]
