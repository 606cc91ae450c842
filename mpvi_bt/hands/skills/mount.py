"""Mount a held thing on another: a poster on a nail, a camera on a tripod."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from mpvi_bt.finding.scene.hands import Held
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.motion import GRIP, Actions, MotionFailure
from mpvi_bt.hands.motion.approach import FEEL, approach, going_around, leave, lines, take_up, withdraw
from mpvi_bt.hands.motion.carry import settle
from mpvi_bt.hands.motion.gaze import look_at
from mpvi_bt.hands.motion.work import Words, Work
from mpvi_bt.hands.stance.stance import Option


@dataclass(frozen=True)
class Mounting:
    """How two mounts are brought together."""

    off_m: float = 0.10  # standoff of the mounts before, and of the hand after it [m]; our choice
    beyond_m: float = 0.01  # target of the hand past the meeting point [m]; it stops at contact; our choice
    # turns about the direction of approach [rad]; 15 degrees are allowed; our choice
    leans_rad: tuple[float, ...] = (0.0, 0.12, -0.12)


_MOUNT = Mounting()


def mount(work: Work, words: Words, tried: list[Array]) -> Actions:
    """Bring the mount of the held `words["object"]` to that of `words["target"]`, and let go.

    Raises:
        MotionFailure: "not_held", "unknown_object", "no_mount" if none of them fit, "no_stance", "missed" if it does
            not stay there, or a motion's own reason.
    """
    side = work.hand_with(words["object"], words.get("hand"))
    held, target = work.load(side), work.nearest(words["target"])
    yield from look_at(work, target)
    if not any(True for _ in _options(work, held, target)):
        raise MotionFailure("no_mount")
    stance, search = yield from going_around(
        work, target, lambda: approach(work, side, target, lambda: list(_options(work, held, target)), tried)
    )
    try:
        yield from take_up(work, stance, search)
        yield from work.motion.wait(FEEL.calm_s)
        T = matmul(kin.inverse(work.base), kin.base(stance.base), stance.waypoints[1])
        yield from work.motion.line(side, T, FEEL.speed_m_s, until_contact=True)
    except MotionFailure:
        yield from withdraw(work, side, stance)
        raise
    yield from work.motion.wait(0.3)
    yield from work.motion.grip(side, 1.0, GRIP.firm_s)
    with suppress(MotionFailure):
        yield from lines(work, side, stance, [2])
    yield from leave(work, stance)
    yield from settle(work, without={target, held.name})
    if work.scene.mounts(target) and all(mount.free for mount in work.scene.mounts(target)):
        raise MotionFailure("missed")


def _options(work: Work, held: Held, target: str) -> Iterator[Option]:
    """Ways of the hand for each pair that fits: before the mounts meet, where they do, and back without the thing."""
    pose = work.scene.pose(held.name)
    for mine in work.scene.mounts(held.name):
        for theirs in work.scene.mounts(target):
            if mine.kind != theirs.kind or not mine.male or theirs.male or not theirs.free:
                continue
            to_tcp = matmul(kin.inverse(mine.pose), pose, kin.inverse(held.T_tcp_thing))
            out = theirs.pose[:3, 0]
            for lean in _MOUNT.leans_rad:
                turn = np.asarray(Rotation.from_rotvec([lean, 0.0, 0.0]).as_matrix())
                T = matmul(theirs.pose, kin.transform(turn, np.zeros(3)), to_tcp)
                before, on = (kin.transform(T[:3, :3], T[:3, 3] + d * out) for d in (_MOUNT.off_m, -_MOUNT.beyond_m))
                back = kin.transform(T[:3, :3], T[:3, 3] - _MOUNT.off_m * T[:3, 2])
                yield Option(np.stack([before, on, back]), 1, abs(lean))
