"""Bringing what is held home, to be carried."""

from __future__ import annotations

import numpy as np
import pytest

from mpvi_bt.manipulation.carry import settle
from mpvi_bt.manipulation.truth import TrueScene
from mpvi_bt.manipulation.work import Work
from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.motion import Motion, MotionFailure
from mpvi_bt.robot.protocol import ActionLayout
from mpvi_bt.robot.r1 import R1
from tests.small_house import placed, run, small_world

# A hand beside the back [rad], from where no level way leads home.
BEHIND, BENT = (-1.48, -2.58, 0.58, -0.15, -0.14, 1.28, 0.42), (0.29, -0.06, -0.03, 0.51)


@pytest.mark.parametrize("filled", [False, True])
def test_what_no_level_way_leads_home_for_may_tip_unless_it_is_filled(filled: bool) -> None:
    """An arm that was stopped far off may have no other way: it would stay there, and nothing could be done with it."""
    world = small_world({"can": placed("can_of_soda", -1.0, 0.5), "egg": placed("easter_egg", -1.0, 1.0)})
    reaching = world.robot.action.copy()
    reaching[ActionLayout.ARM["right"]] = BEHIND
    reaching[ActionLayout.TORSO] = BENT
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
            world.step(action)
            work.motion.felt = glued().motion.felt
    except MotionFailure as failure:
        assert filled
        assert failure.reason == "no_carry"
    else:
        assert not filled
        assert before < 0.0 < 0.2 < work.motion.hand("right")[0, 3]
