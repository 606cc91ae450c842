"""Taking what is too wide for one hand: a box is pressed from both sides with open hands, raised and drawn back."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot import arm_motion
from mpvi_bt.ground.robot.motion import GRIP, Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, SIDES
from mpvi_bt.ground.robot.squeeze import pressing, squeezes
from mpvi_bt.hands.motion.approach import APPROACH
from mpvi_bt.hands.motion.both_hands import BENDING, IN_STEP, open_wide, raise_both, straighten_up, together
from mpvi_bt.hands.motion.work import Words, Work
from mpvi_bt.hands.skills.box_grip import Box, BoxGrip, find_grip
from mpvi_bt.hands.stance.base_search import behind
from mpvi_bt.hands.stance.postures import WAY_MARGINS_M
from mpvi_bt.hands.stance.stance_search import Search


@dataclass(frozen=True)
class LiftingBoth:
    """How a box is lifted off its support."""

    pressing_s: float = 0.2  # time for the hands to build up force [s]; a longer rest looks like the end; our choice
    up_m: float = 0.15  # lift of the box before the base draws it back [m]; our choice


_LIFT = LiftingBoth()


def lift(work: Work, words: Words, tried: list[Array]) -> Actions:
    """Take the thing that `words["object"]` names between both hands and raise it.

    Raises:
        MotionFailure: "unknown_object", "hands_full", "no_grasp", "no_stance", "not_squeezed", "slipped", or a motion's
            own reason.
    """
    scene, motion = work.scene, work.motion
    name = work.nearest(words["object"])
    if scene.between() == name:
        return  # in hand already
    if work.held() or squeezes(motion.felt):
        raise MotionFailure("hands_full")
    grip, search = yield from find_grip(work, name, tried)
    tried.append(grip.base)
    yield from together(motion.grip("left", 1.0, GRIP.empty_s), motion.grip("right", 1.0, GRIP.empty_s), motion_of=work)
    yield from _go_behind(work, grip, search)
    yield from motion.drive(grip.base, speed=APPROACH.inward_m_s)
    yield from _close_in(work, grip.box)
    yield from _press(work)
    if not squeezes(motion.felt):
        yield from open_wide(work)
        raise MotionFailure("not_squeezed")
    yield from raise_both(work, _LIFT.up_m)
    away = float(norm(grip.back[:2] - grip.base[:2]))
    yield from motion.drive(behind(motion.felt.base_pose, away), speed=APPROACH.inward_m_s)
    yield from straighten_up(work)
    yield from work.see("head")
    if not squeezes(motion.felt) or scene.between() != name:
        raise MotionFailure("slipped")


def _go_behind(work: Work, grip: BoxGrip, search: Search) -> Actions:
    """Form the arms some way before the box, where there is room."""
    motion = work.motion
    for pose in grip.way:
        yield from motion.drive(pose)
    trunk = motion.robot.trunk
    posture = np.append(trunk.posture(grip.torso)[:3], motion.posture[3])
    torso = trunk.joints(posture)
    posture[0] = max(posture[0], BENDING.folded_m)  # bent as low as that, the folded hands would meet the base
    yield from motion.stand(trunk.joints(posture))
    around = search.around(grip.back, touched=True)
    for side in SIDES:
        body = replace(motion.body(), around=around)
        paths = (arm_motion.plan(body, side, grip.arms[side][0], work.rng, margin) for margin in (*WAY_MARGINS_M, 0.0))
        if (path := next((path for path in paths if path is not None), None)) is None:
            raise MotionFailure("no_path")
        yield from motion.follow(side, path)
    yield from motion.stand(torso)


def _close_in(work: Work, box: Box) -> Actions:
    """Bring both hands to the sides, from where the base really stands."""
    to_base = kin.inverse(work.base)
    hands, speed = box.hands(work.motion.robot.hand, 0.0), IN_STEP.closing_m_s
    lines = [work.motion.line(side, matmul(to_base, hands[side]), speed, give_rad=np.inf) for side in SIDES]
    yield from together(*lines, motion_of=work)


def _press(work: Work) -> Actions:
    """Press with both hands straight toward each other."""
    motion = work.motion
    start = {side: motion.arm(side) for side in SIDES}
    told = pressing(motion.robot, motion.torso, start)
    n = round(_LIFT.pressing_s * CONTROL_HZ)
    for k in range(1, n + 1):
        for side in SIDES:
            motion.action[motion.layout.arm[side]] = start[side] + (told[side] - start[side]) * k / n
        yield motion.still()
    yield motion.still()
