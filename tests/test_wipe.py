"""Wiping and spraying: strokes leave nothing out, and a top is really gone over."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.finding.scene.hands import Held
from mpvi_bt.ground.geometry.rays import interval
from mpvi_bt.ground.geometry.solids import bounds, box, pose
from mpvi_bt.ground.robot.collision import Load
from mpvi_bt.ground.robot.motion import Motion
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.skills.aim import aims
from mpvi_bt.hands.skills.wipe import strokes_over, wipe
from mpvi_bt.house.sim.world import Placement
from mpvi_bt.house.things.catalogue import load_catalogue
from mpvi_bt.house.truth.true_scene import TrueScene
from mpvi_bt.testing.full_hands import put_in_hands
from tests.small_house import placed, small_world

LADLE = """
entries:
  ladle:
    synset: ladle.n.01
    family: compound
    shape:
      color: "#c9cdd2"
      pieces:
        - {kind: box, at: [0, 0, 0.02], size_m: [0.16, 0.1, 0.04]}
        - {kind: box, at: [0.2, 0, 0.015], size_m: [0.24, 0.03, 0.03]}
    mass_kg: 0.8
    friction: 0.8
"""
ATOMIZER = box((0.0, 0.0, 0.1), (0.06, 0.06, 0.24))  # in its own frame: its top is 22 cm above its origin
sizes = st.tuples(st.floats(0.02, 0.25), st.floats(0.02, 0.25))


@given(sizes, sizes)
def test_strokes_cover_a_patch_with_any_tool(half: tuple[float, float], reach: tuple[float, float]) -> None:
    """Every point of the patch is under the tool at some place between two turning points."""
    patch, tool = np.array(half), np.array(reach)
    points = np.stack(strokes_over(patch, tool))
    between = [a + (b - a) * u for a, b in pairwise(points) for u in np.linspace(0, 1, 30)]
    way = np.stack([points[0], *between, points[-1]])
    grid = np.stack(np.meshgrid(*(np.linspace(-h, h, 9) for h in half)), -1).reshape(-1, 2)
    step = np.abs(np.diff(way, axis=0)).max() if len(way) > 1 else 0.0
    under = (np.abs(grid[:, None] - way[None]) <= tool + step + 1e-9).all(-1).any(1)
    assert under.all()


@given(sizes, sizes)
def test_strokes_stay_within_the_patch(half: tuple[float, float], reach: tuple[float, float]) -> None:
    """The tool does not hang over an edge unless it is larger than the patch, and then it stays in the middle."""
    patch, tool = np.array(half), np.array(reach)
    for point in strokes_over(patch, tool):
        assert (np.abs(point) + np.minimum(tool, patch) <= patch + 1e-9).all()


@given(sizes, sizes)
def test_no_stroke_is_made_twice(half: tuple[float, float], reach: tuple[float, float]) -> None:
    """Turning points differ from each other."""
    points = [tuple(np.round(p, 9)) for p in strokes_over(np.array(half), np.array(reach))]
    assert len(set(points)) == len(points)


def test_what_has_several_tops_is_wiped_on_all_of_them(tmp_path: Path) -> None:
    """No dust is left on a part of a thing beyond the end of a larger one, a centimeter lower."""
    file = tmp_path / "ladle.yaml"
    file.write_text(LADLE, encoding="utf-8")
    ladle = Placement(load_catalogue(file)["ladle"], pose((0.6, -0.15, 0.741), np.pi / 2))
    things = {"ladle": ladle, "brush": placed("scrub_brush", -1.5, 0.0)}
    world = small_world(things, desk="{entry: desk, at: [0.8, 0.0], yaw_deg: 180}")
    put_in_hands(world, {"right": "brush"})
    world.mark("ladle", "dust.n.01")
    work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))
    for action in wipe(work, {"target": "ladle", "tool": "scrub brush"}, []):
        world.robot.act(action)
        world.step()
        work.motion.felt = world.robot.proprioception()
    assert not world.covered("ladle", "dust.n.01")


@given(st.floats(0.7, 2.5), st.floats(-np.pi, np.pi))
def test_a_sprayer_is_aimed_with_its_top_level_with_the_target(tall_m: float, yaw: float) -> None:
    """It sprays from there: it would spray over a plant that ends below it."""
    plant, T_world_thing = box((2.0, 1.0, tall_m / 2), (0.3, 0.3, tall_m)), pose((0.0, 0.0, 0.9), yaw)
    T_tcp_thing = pose((0.0, 0.02, 0.01), 0.3)
    solids = (ATOMIZER.moved(T_tcp_thing),)
    held = Held("atomizer", "left", T_tcp_thing, solids, Load(solids))
    work = SimpleNamespace(scene=SimpleNamespace(solids=lambda name: [plant], pose=lambda name: T_world_thing))
    ways = list(aims(work, held, "plant"))  # type: ignore[arg-type]
    assert ways
    for way in ways:
        thing = way.waypoints[1] @ T_tcp_thing
        _, highest = bounds([ATOMIZER.moved(thing)])
        assert highest[2] < tall_m
        assert interval(plant, np.append(thing[:2, 3], highest[2]), thing[:3, 0]) is not None
