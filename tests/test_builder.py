"""Houses and objects as SAPIEN builds them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mpvi_bt.ground.geometry.solids import pose
from mpvi_bt.house.layout.house import load_house
from mpvi_bt.house.sim.builder import Thing, build_house, build_object
from mpvi_bt.house.sim.shaders import new_scene, shader_folder
from mpvi_bt.house.sim.views import look_at, overview
from mpvi_bt.house.things.catalogue import load_catalogue

HOUSE = load_house()
CATALOGUE = load_catalogue()


@pytest.fixture(scope="module")
def built():
    scene = new_scene(render=False)
    return scene, build_house(scene, HOUSE, render=False)


def test_everything_is_built(built) -> None:
    """Fixtures, and a floor and walls for each room, are things under their own names."""
    _, things = built
    floors = {f"floor_{room}" for room in HOUSE.rooms}
    walls = {f"wall_{room}" for room in HOUSE.rooms}
    assert set(things) == {*HOUSE.fixtures, *floors, *walls, "wall_outside"}


def test_closed_fixtures_stand_where_the_house_says(built) -> None:
    """A thing's solids, posed by the simulator, are those of the house."""
    _, things = built
    for fixture in HOUSE.fixtures.values():
        theirs = things[fixture.name].solids()
        ours = list(fixture.solids())
        assert len(theirs) == len(ours)
        for a, b in zip(theirs, ours, strict=True):
            np.testing.assert_allclose(a.aabb(), b.aabb(), atol=1e-4)


@pytest.mark.parametrize("name", [e.name for e in CATALOGUE if e.mass_kg is not None])
def test_objects_rest_on_the_floor(name: str) -> None:
    """An object of its catalogue mass, let go just above the floor, stays where it is and falls asleep."""
    scene = new_scene(render=False)
    house = build_house(scene, HOUSE, render=False)
    entry = CATALOGUE[name]
    thing = build_object(scene, entry, name, pose((6.0, 2.5, 0.002)), render=False)
    for _ in range(240):
        scene.step()
    bodies = [thing.rigid_body] if thing.articulation is None else thing.articulation.links
    assert sum(body.mass for body in bodies) == pytest.approx(entry.mass_kg)
    np.testing.assert_allclose(thing.T_world_body()[:3, 3], (6.0, 2.5, 0.0), atol=0.005)
    assert thing.rigid_body.is_sleeping if thing.articulation is None else thing.root_body.sleeping
    touched = {body.entity for contact in scene.get_contacts() for body in contact.bodies}
    assert not touched & set(house["floor_living_room"].entities.values())


def test_a_falling_can_touches_its_rooms_floor_only() -> None:
    """Contacts tell the rooms' floors apart."""
    scene = new_scene(render=False)
    house = build_house(scene, HOUSE, render=False)
    can = build_object(scene, CATALOGUE["can_of_soda"], "can", pose((9.6, 3.0, 0.05)), render=False)
    touched = set()
    for _ in range(60):
        scene.step()
        for contact in scene.get_contacts():
            entities = {body.entity for body in contact.bodies}
            if can.entity in entities:
                touched |= {name for name, thing in house.items() if entities & set(thing.entities.values())}
    assert touched == {"floor_living_room"}


JOINTED = [f.name for f in HOUSE.fixtures.values() if f.entry.description.jointed]


@pytest.mark.parametrize("name", JOINTED)
def test_doors_open_and_close_alone(built, name: str) -> None:
    """A push opens every door by at least 1.2 rad (or its drawer fully) and another closes it, with the rest shut."""
    scene, things = built
    thing: Thing = things[name]
    assert thing.articulation is not None
    assert max(thing.joint_fractions()) < 0.01
    limits = np.array([body.joint.limit for body in thing.description.bodies if body.joint])
    push = np.array([30.0 if body.joint.kind == "slide" else 8.0 for body in thing.description.bodies if body.joint])
    for sign in (1, -1):
        for _ in range(360):
            thing.articulation.set_qf(sign * push)
            scene.step()
        reached = np.array(thing.joint_fractions()) * limits
        if sign > 0:
            assert np.all(reached >= np.minimum(1.2, 0.99 * limits)), reached
        else:
            assert np.all(reached < 0.02), reached
    thing.articulation.set_qf(np.zeros(len(limits)))


def test_volumes_follow_a_drawer(built) -> None:
    """What a drawer can hold moves with it."""
    _, things = built
    chest: Thing = things["chest_of_drawers_1"]
    before = chest.volumes()
    chest.set_joint_fraction("drawer_2", 1.0)
    after = chest.volumes()
    chest.set_joint_fraction("drawer_2", 0.0)
    moved = [np.linalg.norm(a.T[:3, 3] - b.T[:3, 3]) for a, b in zip(before, after, strict=True)]
    travel = next(b.joint.limit for b in chest.description.bodies if b.name == "drawer_2" and b.joint)
    assert moved == pytest.approx([0, travel, 0], abs=1e-4)


LIDDED = [e.name for e in CATALOGUE if e.mass_kg is not None and e.description.jointed]


@pytest.mark.parametrize("name", LIDDED)
def test_a_lid_stays_where_it_is_left(name: str) -> None:
    """Half open, a lid neither falls shut nor falls open, and what it is on stays upright; its joint tells how far."""
    scene = new_scene(render=False)
    build_house(scene, HOUSE, render=False)
    thing = build_object(scene, CATALOGUE[name], name, pose((6.0, 2.5, 0.002)), render=False)
    thing.set_joint_fraction("lid", 0.5)
    for _ in range(360):
        scene.step()
    assert thing.joint_fractions() == pytest.approx([0.5], abs=0.03)
    assert thing.T_world_body()[2, 2] > 0.999


@pytest.mark.parametrize("name", LIDDED)
def test_what_has_a_lid_is_placed_and_put_back_with_it(name: str) -> None:
    """Placed elsewhere its lid goes with it; brought back to how it stood, it stands there, lid and all."""
    scene = new_scene(render=False)
    build_house(scene, HOUSE, render=False)
    thing = build_object(scene, CATALOGUE[name], name, pose((6.0, 2.5, 0.002)), render=False)
    thing.set_joint_fraction("lid", 0.5)
    before, lid = thing.motion(), np.linalg.inv(thing.T_world_body()) @ thing.T_world_body("lid")
    thing.place(pose((5.0, 2.0, 0.3), 1.0))
    np.testing.assert_allclose(thing.T_world_body(), pose((5.0, 2.0, 0.3), 1.0), atol=1e-5)
    np.testing.assert_allclose(thing.T_world_body() @ lid, thing.T_world_body("lid"), atol=1e-5)
    for _ in range(60):
        scene.step()
    thing.set_motion(before)
    assert {k: pytest.approx(v, abs=1e-5) for k, v in before.items()} == thing.motion()


def test_a_fixture_with_a_mass_moves(built) -> None:
    """What the house has that rolls is pushed by some 40 N; it stays upright."""
    scene, things = built
    chair: Thing = things["swivel_chair_1"]
    before = chair.T_world_body()
    for _ in range(60):
        chair.rigid_body.add_force_at_point([40.0, 0.0, 0.0], chair.T_world_body()[:3, 3] + [0.0, 0.0, 0.4])
        scene.step()
    moved = chair.T_world_body()
    chair.place(before)
    assert moved[0, 3] - before[0, 3] > 0.05
    assert moved[2, 2] > 0.99


def test_a_fixture_is_no_object() -> None:
    """What has no mass cannot be built as an object."""
    with pytest.raises(ValueError, match="fixture"):
        build_object(new_scene(render=False), CATALOGUE["sofa"], "sofa", np.eye(4), render=False)


def run(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_no_rendering_device_is_said_in_one_line() -> None:
    """Without a Vulkan driver a scene with pictures is refused with the command that helps; one without works."""
    code = (
        "from mpvi_bt.house.sim.shaders import new_scene\n"
        "from mpvi_bt.ground.errors import NoRenderingDevice\n"
        "new_scene(False).step()\n"
        "try:\n    new_scene(True)\n"
        "except NoRenderingDevice as error:\n    print(error)\n"
    )
    done = run(code, VK_DRIVER_FILES="/nonexistent", VK_ICD_FILENAMES="/nonexistent")
    assert done.returncode == 0, done.stderr
    assert "mpvi doctor" in done.stdout
    assert len(done.stdout.strip().splitlines()) == 1


def test_shaders_are_the_packages_own_without_the_table(tmp_path: Path) -> None:
    """The light shaders are written where the user's cache is, and no longer name the table."""
    code = "from mpvi_bt.house.sim.shaders import shader_folder\nprint(shader_folder())"
    done = run(code, XDG_CACHE_HOME=str(tmp_path))
    folder = Path(done.stdout.strip())
    assert tmp_path in folder.parents
    texts = [path.read_text() for path in folder.iterdir()]
    assert len(texts) == len(list(Path(shader_folder()).iterdir()))
    assert not any("BRDFLUT" in text for text in texts)
    assert (folder.parent / "common" / "lights.glsl").is_file()


def test_look_at_is_a_right_handed_upright_camera() -> None:
    """The optical frame looks at the target, with x level and y down."""
    T = look_at((1.0, 2.0, 1.5), (4.0, 3.0, 0.5))
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1)
    assert T[2, 0] == pytest.approx(0)
    assert T[2, 1] < 0


@pytest.mark.parametrize("aspect", [4 / 3, 16 / 9, 1.0])
def test_the_overview_holds_the_whole_house(aspect: float) -> None:
    """Every corner of the grounds falls into the picture."""
    x0, y0, x1, y1 = HOUSE.bounds()
    corners = np.array([(x, y, z, 1) for x in (x0, x1) for y in (y0, y1) for z in (0, 2.2)])
    seen = corners @ np.linalg.inv(overview(HOUSE, 0.6, aspect)).T
    limits = np.tan(0.3) * np.array([aspect, 1])
    assert np.all(np.abs(seen[:, :2] / seen[:, 2:3]) < limits)


@pytest.mark.render
def test_rooms_are_lit_and_colorful() -> None:
    """A picture of each room from eye height is neither dark nor washed out nor of few colors."""
    import sapien

    scene = new_scene(render=True)
    build_house(scene, HOUSE, render=True)
    camera = scene.add_camera("eye", 160, 120, 1.1, 0.05, 50)
    to_link = np.eye(4)
    to_link[:3, :3] = [[0, -1, 0], [0, 0, -1], [1, 0, 0]]  # SAPIEN's cameras look along x
    for room in HOUSE.rooms:
        x0, y0, x1, y1 = HOUSE.room(room).rect
        eye = look_at(np.array([x1 - 0.3, y0 + 0.3, 1.5]), ((x0 + x1) / 2, (y0 + y1) / 2, 0.7))
        camera.entity.set_pose(sapien.Pose(eye @ to_link))
        scene.update_render()
        camera.take_picture()
        picture = camera.get_picture("Color")[..., :3].astype(float)
        assert 60 < picture.mean() < 230, room
        assert len(np.unique(picture.reshape(-1, 3) // 32, axis=0)) >= 8, room
