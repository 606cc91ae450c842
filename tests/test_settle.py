"""Bringing what is held home, to be carried."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array, Solid, box, pose
from mpvi_bt.ground.robot.collision import Surroundings
from mpvi_bt.ground.robot.motion import Motion, MotionFailure
from mpvi_bt.ground.robot.protocol import Proprioception, Side
from mpvi_bt.hands.motion import carry
from mpvi_bt.hands.motion.carry import settle, tuck
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.hands.robots.r1pro import R1PRO
from mpvi_bt.house.truth.true_scene import TrueScene
from tests.layouts import LAYOUT
from tests.small_house import placed, run, small_world
from tests.test_looking_down import HANDS
from tests.test_motion import play, reaching

# A hand beside the back [rad], from where no level way leads home.
BEHIND, BENT = (-1.48, -2.58, 0.58, -0.15, -0.14, 1.28, 0.42), (0.29, -0.06, -0.03, 0.51)
BELOW, DOWN = (-1.22, 0.27, -0.61, -0.69, 0.78, 1.08, -2.79), (0.0, 0.0, 0.8, 0.5)  # a hand just above the floor


@pytest.mark.parametrize("filled", [False, True])
def test_what_no_level_way_leads_home_for_may_tip_unless_it_is_filled(filled: bool) -> None:
    """An arm that was stopped far off may have no other way: it would stay there, and nothing could be done with it."""
    world = small_world({"can": placed("can_of_soda", -1.0, 0.5), "egg": placed("easter_egg", -1.0, 1.0)})
    reaching = world.robot.action.copy()
    reaching[LAYOUT.arm["right"]] = BEHIND
    reaching[LAYOUT.torso] = BENT
    run(world, reaching, 4.0)
    world.robot.act(reaching)
    scene = TrueScene(world)
    scene.holding = lambda side: "can" if side == "right" else None
    scene.within = lambda name: ["egg"] if filled else []

    def glued() -> Work:
        felt = world.robot.proprioception()
        in_hand = kin.transform(np.eye(3), (0.0, 0.0, 0.05))
        world.place("can", kin.base(felt.base_pose) @ R1.tcp(felt.torso, felt.arm["right"], "right") @ in_hand)
        return Work(scene, Motion(felt), np.random.default_rng(0))

    work = glued()
    before = work.motion.hand("right")[0, 3]
    try:
        for action in settle(work):
            world.robot.act(action)
            world.step()
            work.motion.felt = glued().motion.felt
    except MotionFailure as failure:
        assert filled
        assert failure.reason == "no_carry"
        assert "not looked at" in failure.evidence  # the search is bounded, and says so
    else:
        assert not filled
        assert before < 0.0 < 0.2 < work.motion.hand("right")[0, 3]


def test_who_bends_down_and_finds_no_level_way_straightens_up_with_what_is_held(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It would stay bent for good, and nothing is set down or driven to from there; it hangs level at the end."""
    level = carry._homeward
    monkeypatch.setattr(carry, "_homeward", lambda work, *a: None if work.motion.torso[2] > 0.1 else level(work, *a))
    world = small_world({"can": placed("can_of_soda", -1.0, 0.5)})
    scene = TrueScene(world)
    scene.holding = lambda side: "can" if side == "left" else None
    bent = world.robot.action.copy()
    bent[LAYOUT.arm["left"]] = BELOW
    bent[LAYOUT.torso] = DOWN
    run(world, bent, 4.0)
    world.robot.act(bent)

    def felt() -> Proprioception:
        felt = world.robot.proprioception()
        world.place("can", kin.base(felt.base_pose) @ R1.tcp(felt.torso, felt.arm["left"], "left"))
        return felt

    work = Work(scene, Motion(felt()), np.random.default_rng(0))
    before = work.motion.hand("left")
    for action in settle(work):
        world.robot.act(action)
        world.step()
        work.motion.felt = felt()
    np.testing.assert_allclose(work.motion.torso[:3], R1.travel_torso[:3], atol=0.01)
    np.testing.assert_allclose(work.motion.hand("left")[2, :3], before[2, :3], atol=0.05)


def test_what_found_no_way_home_is_asked_again_only_after_something_has_changed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The search takes seconds, and every recovery asks for it; its refusal names what is in the way."""
    world = small_world({"can": placed("can_of_soda", -1.0, 0.5), "board": placed("chopping_board", -1.0, 1.0)})
    scene, motion = TrueScene(world), reaching("left")
    scene.holding = lambda side: "can" if side == "left" else None
    low = np.array([0.2, 0.0, 0.0, 0.0])  # it may not rise: there is something right above the head
    motion = Motion(replace(motion.felt, torso=low, arm={**R1.travel_arm, "left": motion.arm("left")}))
    work = Work(scene, motion, np.random.default_rng(0))
    world.place("can", work.hand("left"))
    world.place("board", pose((0.0, 0.0, 1.32)))
    walls = [box((-0.42, 0.0, 0.2), (0.1, 2.0, 0.4)), *(box((0.0, y, 0.2), (2.0, 0.1, 0.4)) for y in (-0.42, 0.42))]
    monkeypatch.setattr(scene, "obstacles", lambda *_, **__: Surroundings([*walls, *scene.solids("board")]))
    search, asked = carry._searched, []

    def searched(*args: Any) -> Any:
        asked.append(args)
        return search(*args)

    monkeypatch.setattr(carry, "_searched", searched)
    for tilt, times in ((0.0, 1), (0.0, 1), (0.3, 2)):
        play(motion, motion.stand(motion.bent(tilt=tilt)))
        with pytest.raises(MotionFailure, match="no_carry") as failure:
            play(motion, settle(work))
        assert len(asked) == times
        assert failure.value.evidence == "1 candidates: 1 in the way (board)"


@pytest.mark.parametrize("ahead", [False, True])
def test_what_is_carried_keeps_clear_of_what_stands_around(monkeypatch: pytest.MonkeyPatch, ahead: bool) -> None:
    """Arms give way by a centimeter: where hand or elbow would graze a wall it is carried elsewhere, or stays."""
    _, home, _, edges = tucked(monkeypatch, [])
    assert np.linalg.norm(home[:2, 3]) < 0.35
    x, y = edges[:2] + 0.06
    wall = box((x, 0.0, 1.0), (0.1, 1.5, 2.0)) if ahead else box((0.4, y, 1.0), (1.5, 0.1, 2.0))
    before, after, gap, _ = tucked(monkeypatch, [wall])
    assert gap > 0.03 or np.allclose(after, before)


@pytest.mark.parametrize("posture", [(0.05, 0.0, 0.5, 0.0), (0.05, 0.0, 0.8, 0.0), (0.15, 0.0, 0.5, 0.0)])
def test_an_arm_that_hangs_is_folded_from_a_low_torso(posture: tuple[float, ...]) -> None:
    """There it would be in the base: it stayed out, and the body low, while the other hand held something."""
    world = small_world({"can": placed("can_of_soda", -1.0, 0.5)}, robot=R1PRO)
    torso, down = R1PRO.trunk.joints(np.array(posture)), kin.hand_rotation((0.3, 0.0, -0.95), (0.0, 1.0, 0.0))
    hands: dict[Side, Array] = {
        "left": kin.transform(kin.rot_z(0.8) @ HANDS["left"][:3, :3], R1PRO.aside[1]),
        "right": kin.transform(down, (0.55, -0.3, 0.2)),
    }
    arm = {}
    for side, T in hands.items():
        _, q = R1PRO.arm_inverse((kin.inverse(R1PRO.chest(torso)) @ T)[None], side, swivels=36)
        arm[side] = q[0]
    scene, felt = TrueScene(world), world.robot.proprioception()
    scene.holding = lambda side: "can" if side == "left" else None
    world.place("can", kin.base(felt.base_pose) @ kin.transform(np.eye(3), hands["left"][:3, 3]))
    work = Work(scene, Motion(replace(felt, torso=torso, arm=arm, arm_command=arm)), np.random.default_rng(0))
    play(work.motion, settle(work))
    np.testing.assert_allclose(work.motion.torso, R1PRO.travel_torso, atol=0.01)
    np.testing.assert_allclose(work.motion.arm("right"), R1PRO.travel_arm["right"], atol=0.03)


def tucked(monkeypatch: pytest.MonkeyPatch, walls: list[Solid]) -> tuple[Array, Array, float, Array]:
    """Bring a can that a hand holds out closer.

    Returns:
        The hand's poses (4, 4) before and after, the gap of arm and can to `walls` then, and how far (3,) these reach
        ahead, to the left and up [m].
    """
    world = small_world({"can": placed("can_of_soda", -1.0, 0.5)})
    scene = TrueScene(world)
    scene.holding = lambda side: "can" if side == "left" else None
    work = Work(scene, reaching("left"), np.random.default_rng(0))
    before = work.hand("left")
    world.place("can", before)
    monkeypatch.setattr(scene, "obstacles", lambda *_, **__: Surroundings(walls))
    body = work.body()
    play(work.motion, tuck(work))
    q = work.motion.arm("left")
    centers, radii = body.spheres("left", q)
    return before, work.hand("left"), body.distance("left", q), (centers[0] + radii[:, None]).max(0)
