"""Working over a surface with a held tool: wiping touches it, spraying keeps a distance."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from mpvi_bt.manipulation.stance import Held, Option
from mpvi_bt.manipulation.work import Words, Work
from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.motion import Actions, MotionFailure
from mpvi_bt.robot.protocol import SIDES, Side
from mpvi_bt.robot.solids import Array

_PATCH_M = 0.34  # largest side of what is wiped from one stance
_OVER_M = 0.08  # above the surface on the way there
_WIPE_M = 0.002  # of the tool's underside over the surface: the arm's give does the pressing
_SPRAY_M = 0.15
_TURNS = tuple(np.arange(8) * np.pi / 4)
_SPEED_M_S = 0.25
_SPRAY_S = 1.0  # over every patch


@dataclass(frozen=True, eq=False)
class _Patch:
    """A part of an upper face: middle (3,) on it, half sizes (2,) [m] along its own axes, and their turn [rad]."""

    middle: Array
    half: Array
    yaw: float


def wipe(work: Work, words: Words, tried: list[Array]) -> Actions:
    """Move a held tool, `words["tool"]` if that is said, over the top of `words["target"]` in touch with it.

    Raises:
        MotionFailure: "not_held", "unknown_object", "no_surface", "no_stance", "dropped", or a motion's own reason.
    """
    yield from _work_over(work, words, tried, _WIPE_M, strokes=True)


def spray(work: Work, words: Words, tried: list[Array]) -> Actions:
    """Hold a tool over the top of `words["target"]`, a hand's breadth off, over one part of it after the other.

    Raises:
        MotionFailure: As `wipe`.
    """
    yield from _work_over(work, words, tried, _SPRAY_M, strokes=False)


def _work_over(work: Work, words: Words, tried: list[Array], height: float, strokes: bool) -> Actions:
    side = _tool_hand(work, words)
    target = work.nearest(words.get("target", ""))
    yield from work.look_at(target)
    held = work.held()[side]
    patches = _patches(work, target)
    if not patches:
        raise MotionFailure("no_surface")
    done = 0
    for patch in patches:
        search = work.search(side, {target})
        stance = search.find(patch.middle[:2], list(_options(work, held, patch, height, strokes)), here_first=True)
        if stance is None:
            continue  # out of reach from everywhere, such as the far side of a table at a wall
        done += 1
        yield from work.take_up(stance, search)
        yield from work.lines(side, stance, range(1, len(stance.waypoints)), speed=_SPEED_M_S)
        if not strokes:
            yield from work.motion.wait(_SPRAY_S)
        if not work.gripped(side):
            raise MotionFailure("dropped")
        with contextlib.suppress(MotionFailure):  # where the hand cannot rise, the next drive takes it away
            yield from work.rise(side, _OVER_M)
    if not done:
        raise MotionFailure("no_stance")
    yield from work.settle(without={target})


def _tool_hand(work: Work, words: Words) -> Side:
    """The hand with the tool: what is said to be one, else the only thing held."""
    if "tool" in words:
        return work.hand_with(words["tool"], words.get("hand"))
    for side in SIDES:
        if work.scene.holding(side) is not None and words.get("hand") in (None, side):
            return side
    raise MotionFailure("not_held")


def _patches(work: Work, target: str) -> list[_Patch]:
    """The highest upper face of a thing in parts that one stance can serve, the nearest first."""
    faces = [s for s in work.scene.solids(target) if s.kind != "sphere"]
    if not faces:
        return []
    top = max(float(s.aabb()[1, 2]) for s in faces)
    face = max((s for s in faces if s.aabb()[1, 2] > top - 0.01), key=lambda s: float(np.prod(_flat(s.T, s.half_m)[0])))
    half, yaw = _flat(face.T, face.half_m)
    counts = np.maximum(1, np.ceil(2 * half / _PATCH_M - 0.2)).astype(int)
    step = half / counts
    here = work.motion.felt.base_pose[:2]
    out = []
    for i in range(counts[0]):
        for j in range(counts[1]):
            offset = kin.rot_z(yaw)[:2, :2] @ ((2 * np.array([i, j]) + 1) * step - half)
            out.append(_Patch(np.array([*(face.T[:2, 3] + offset), top]), step, yaw))
    return sorted(out, key=lambda p: float(np.linalg.norm(p.middle[:2] - here)))


def _flat(T: Array, half_m: Array) -> tuple[Array, float]:
    """Half sizes (2,) of a solid's upper face along two level axes, and the turn of the first [rad]."""
    up = int(np.abs(T[2, :3]).argmax())
    i, j = (up + 1) % 3, (up + 2) % 3
    return np.array([half_m[i], half_m[j]]), float(np.arctan2(T[1, i], T[0, i]))


def _options(work: Work, held: Held, patch: _Patch, height: float, strokes: bool) -> Iterator[Option]:
    """Ways of the hand over a patch: the tool upright as it is held, turned, there and back in strokes."""
    R_now = work.scene.pose(held.name)[:3, :3]
    up = int(np.abs(R_now[2]).argmax())
    lean = np.cross(R_now[:, up] * np.sign(R_now[2, up]), [0.0, 0.0, 1.0])
    if (sine := float(np.linalg.norm(lean))) > 1e-6:
        R_now = np.asarray(Rotation.from_rotvec(lean / sine * np.arcsin(min(1.0, sine))).as_matrix()) @ R_now
    to_tcp = kin.inverse(held.T_tcp_thing)
    for turn in _TURNS:
        R = kin.rot_z(turn) @ R_now
        boxes = np.stack([s.moved(kin.transform(R, (0.0, 0.0, 0.0)) @ to_tcp).aabb() for s in held.solids])
        low = boxes[:, 0].min(0)
        underside = boxes[boxes[:, 0, 2] < low[2] + 0.01]
        middle = (underside[:, 0].min(0) + underside[:, 1].max(0))[:2] / 2
        reach = (underside[:, 1].max(0) - underside[:, 0].min(0))[:2] / 2
        poses = []
        for k, at in enumerate(_strokes(patch, reach) if strokes else [patch.middle[:2]]):
            z = patch.middle[2] + height - low[2]
            T = kin.transform(R, (at[0] - middle[0], at[1] - middle[1], z)) @ to_tcp
            if k == 0:
                over = T.copy()
                over[2, 3] += _OVER_M
                poses.append(over)
            poses.append(T)
        yield Option(np.stack(poses), 1, 0.1 * abs(float(kin.wrap(turn))))


def _strokes(patch: _Patch, reach: Array) -> Sequence[Array]:
    """Turning points (2,) of a way there and back that takes a tool of half sizes (2,) [m] over a patch."""
    turned = kin.rot_z(patch.yaw)[:2, :2]
    reach = np.abs(turned.T) @ reach  # of the tool's outline along the patch's own axes, at most
    reach = np.minimum(reach, patch.half)
    rest = patch.half - reach
    lanes = int(np.ceil(rest[1] / (reach[1]))) + 1
    points = []
    for lane, y in enumerate(np.linspace(-rest[1], rest[1], lanes) if lanes > 1 else [0.0]):
        for x in (-rest[0], rest[0]) if lane % 2 == 0 else (rest[0], -rest[0]):
            points.append(patch.middle[:2] + turned @ [x, y])
    return points
