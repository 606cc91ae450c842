"""Working over a surface with a held tool: wiping touches it, spraying keeps a distance."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from mpvi_bt.finding.scene.hands import Held
from mpvi_bt.finding.shapes.from_above import outline
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array, box
from mpvi_bt.ground.robot import arm_motion
from mpvi_bt.ground.robot.motion import Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.hands.motion.approach import close_in, take_up
from mpvi_bt.hands.motion.carry import settle
from mpvi_bt.hands.motion.gaze import look_at
from mpvi_bt.hands.motion.work import Words, Work
from mpvi_bt.hands.stance.stance import Option, Stance
from mpvi_bt.hands.stance.stance_search import Search

OVER_M = 0.08  # our choice: so far above what it works on a tool comes and goes


@dataclass(frozen=True)
class Patches:
    """The parts into which a surface is divided for work.

    Our choice, by what arms reach from one place.
    """

    wiped_m: float = 0.34  # largest side of a patch that is wiped from one stance [m]
    sprayed_m: float = 0.30  # largest side of a patch that is sprayed from one place [m]
    larger: float = 0.2  # both may be larger by this [ratio]
    least_m: float = 0.2  # smallest side to which a patch out of reach is divided [m]
    alike_m: float = 0.03  # patches that differ by less are one, seen better [m]
    missed: float = 0.05  # part of a surface that may be out of reach [ratio]
    again: int = 3  # times in one call that a patch is tried again after the arm was held up
    top_m: float = 0.01  # upper faces, or undersides of a tool, that differ in height by less are one [m]
    # upper faces this far below the highest are wiped along with it [m]; a tool takes marks that deep (`rules.marks`)
    along_m: float = 0.02


_PATCHES = Patches()


@dataclass(frozen=True)
class Strokes:
    """How a tool moves over a patch."""

    wipe_m: float = 0.002  # height of the tool's underside over the surface [m]; the arm's give presses it; our choice
    past_m: float = 0.03  # overlap of the strokes beyond the edge [m]; sight knows edges no better; our choice
    past_cost: float = 10.0  # cost of each meter less of it; our choice
    lanes: float = 0.85  # distance between two lanes [ratio of the tool's width]; below 1 they overlap; our choice
    # turns of the tool about the vertical, from the patch's axes [rad]; our choice
    turns_rad: tuple[float, ...] = tuple(np.arange(4) * np.pi / 2)
    turn_cost: float = 0.1  # cost of each radian of turn; our choice
    speed_rad_s: float = 1.2  # speed of the fastest joint [rad/s]; our choice
    spray_m: float = 0.15  # height of the tool over the sprayed surface [m]; our choice
    spray_s: float = 1.0  # time over each part of it [s]; our choice


_STROKES = Strokes()


@dataclass(frozen=True, eq=False)
class _Patch:
    """A part of an upper face: middle (3,) on it, half sizes (2,) [m] along its own axes, and their turn [rad]."""

    middle: Array
    half: Array
    yaw: float

    @property
    def area(self) -> float:
        """In square meters."""
        return float(4 * np.prod(self.half))

    def halves(self) -> list[_Patch]:
        """The two parts that it has along its longer side."""
        along = (self.half == self.half.max()) & [True, self.half[0] != self.half[1]]
        half = np.where(along, self.half / 2, self.half)
        step = np.append(matmul(kin.rot_z(self.yaw)[:2, :2], np.where(along, half, 0.0)), 0.0)
        return [_Patch(self.middle + sign * step, half, self.yaw) for sign in (-1, 1)]


def wipe(work: Work, words: Words, tried: list[Array]) -> Actions:
    """Move a held tool, `words["tool"]` if that is said, over the top of `words["target"]` in touch with it.

    Raises:
        MotionFailure: "not_held", "unknown_object", "no_surface", "no_stance", "dropped", "uncovered" (more than a
            twentieth was out of reach), or a motion's own reason.
    """
    yield from _work_over(work, words, tried, _STROKES.wipe_m, strokes=True, stays_s=0.0)


def hover(
    work: Work, words: Words, tried: list[Array], height_m: float = _STROKES.spray_m, stays_s: float = _STROKES.spray_s
) -> Actions:
    """Hold a tool over the top of `words["target"]`, at some height, over one part of it after the other.

    Raises:
        MotionFailure: As `wipe`.
    """
    yield from _work_over(work, words, tried, height_m, strokes=False, stays_s=stays_s)


def _work_over(work: Work, words: Words, tried: list[Array], height: float, strokes: bool, stays_s: float) -> Actions:
    side = tool_hand(work, words)
    # "Sweep the mud off the floor" is about the mud, where that is something with a place of its own.
    dirt = work.scene.knowledge().find(words.get("object", ""))
    target = work.nearest(words["object"] if dirt else words.get("target", ""))
    yield from look_at(work, target)
    left = _patches(work, target, strokes)
    if not left:
        raise MotionFailure("no_surface")
    whole, missed = sum(p.area for p in left), 0.0
    near, again = False, 0
    while left:
        patch = left.pop(0)
        try:
            left[:0] = yield from _over(work, side, target, patch, height, strokes, stays_s, near)
            near = True
        except MotionFailure as failure:
            if failure.reason == "dropped" or (failure.reason != "no_stance" and again >= _PATCHES.again):
                raise
            near = False
            if failure.reason == "no_stance":
                missed += patch.area  # out of reach from everywhere, such as the far side of a table at a wall
            else:
                again += 1
                left.append(patch)
    if missed > whole * (1 - _PATCHES.missed):
        raise work.no_stance()
    yield from settle(work, without={target})
    if missed > whole * _PATCHES.missed:
        raise MotionFailure("uncovered")


def _over(
    work: Work, side: Side, target: str, patch: _Patch, height: float, strokes: bool,
    stays_s: float, near: bool,
) -> Generator[Array, None, list[_Patch]]:  # fmt: skip
    """Go over a patch of a surface or, where no stance serves all of it, a part; if `near` without another look.

    Returns:
        The parts of the patch that are left.
    """
    left: list[_Patch] = []

    def find(search: Search, here_first: bool) -> Stance | None:
        seen = min(_patches(work, target, strokes), key=lambda p: float(norm(p.middle - patch.middle)), default=patch)
        if (
            np.abs(seen.half - patch.half).max() > _PATCHES.alike_m
            or norm(seen.middle - patch.middle) > _PATCHES.alike_m
        ):
            seen = patch  # from near the robot sees less of it, or takes it for something else
        grounded, parts = _grounded(work, search, target), [seen]
        while parts:
            for k, part in enumerate(parts):
                options = list(_options(work, work.load(side), part, height, strokes))
                if (stance := grounded.find(part.middle[:2], options, here_first)) is not None:
                    left[:] = parts[:k] + parts[k + 1 :]
                    return stance
            parts = [half for part in parts if 2 * part.half.max() > _PATCHES.least_m for half in part.halves()]
        return None

    search = work.search(side, {target})
    stance = find(search, True) if near else None
    if stance is None:
        stance, search = yield from close_in(work, side, {target}, target, find, [])
    yield from take_up(work, stance, search)
    motion, path, up = work.motion, [work.motion.arm(side)], 0
    for T in matmul(kin.inverse(work.base), kin.base(stance.base), stance.waypoints[1:]):
        line = arm_motion.trace(motion.robot, motion.torso, side, path[-1], T)
        if line is None:
            raise MotionFailure("no_reach")
        path, up = path + line[1:], len(line) - 1
    # At one go: stopping at each turn takes twice as long.
    yield from motion.follow(side, path[:-up], _STROKES.speed_rad_s, gently=False)
    if not strokes:
        yield from motion.wait(stays_s)
    yield from motion.follow(side, path[-up - 1 :], _STROKES.speed_rad_s)  # the last line leads off the surface
    if not work.gripped(side):
        raise MotionFailure("dropped")
    return left


def _grounded(work: Work, search: Search, target: str) -> Search:
    """Keep the base out from under what is wiped where that is only seen: from near, its front is out of view."""
    if not work.scene.needs_looks:
        return search
    columns = []
    for low, high in (s.aabb() for s in work.scene.solids(target)):
        (x, y, z), (wide, deep, _) = low.tolist(), (high - low).tolist()
        columns.append(box((x + wide / 2, y + deep / 2, z / 2), (wide, deep, max(z, 0.02))))
    return replace(search, touched=[*search.touched, *columns])


def tool_hand(work: Work, words: Words) -> Side:
    """The hand with the tool: what is said to be one, else the only thing held."""
    if "tool" in words:
        return work.hand_with(words["tool"], words.get("hand"))
    for side in SIDES:
        if work.scene.holding(side) is not None and words.get("hand") in (None, side):
            return side
    raise MotionFailure("not_held")


def _patches(work: Work, target: str, strokes: bool) -> list[_Patch]:
    """The highest upper face of a thing, with what else is to be wiped, in parts for one stance each, nearest first."""
    faces = [s for s in work.scene.solids(target) if s.kind != "sphere"]
    if not faces:
        return []
    top = max(float(s.aabb()[1, 2]) for s in faces)
    face = max(
        (s for s in faces if s.aabb()[1, 2] > top - _PATCHES.top_m),
        key=lambda s: float(np.prod(_flat(s.T, s.half_m)[0])),
    )
    half, yaw = _flat(face.T, face.half_m)
    middle = face.T[:2, 3]
    along = [s for s in faces if s.aabb()[1, 2] > top - _PATCHES.along_m]
    if strokes and len(along) > 1:
        axes = kin.rot_z(yaw)[:2, :2]
        edge = matmul(outline(along), axes)
        half, middle = np.ptp(edge, axis=0) / 2, matmul(axes, (edge.min(0) + edge.max(0)) / 2)
    counts = np.maximum(
        1, np.ceil(2 * half / (_PATCHES.wiped_m if strokes else _PATCHES.sprayed_m) - _PATCHES.larger)
    ).astype(int)
    step = half / counts
    here = work.motion.felt.base_pose[:2]
    out = []
    for i in range(counts[0]):
        for j in range(counts[1]):
            offset = matmul(kin.rot_z(yaw)[:2, :2], (2 * np.array([i, j]) + 1) * step - half)
            out.append(_Patch(np.array([*(middle + offset), top]), step, yaw))
    return sorted(out, key=lambda p: float(norm(p.middle[:2] - here)))


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
    if (sine := float(norm(lean))) > 1e-6:
        R_now = matmul(np.asarray(Rotation.from_rotvec(lean / sine * np.arcsin(min(1.0, sine))).as_matrix()), R_now)
    to_tcp = kin.inverse(held.T_tcp_thing)
    along = R_now[:, (up + 1) % 3]
    aligned = patch.yaw - float(np.arctan2(along[1], along[0]))
    for turn, past in product(_STROKES.turns_rad, (_STROKES.past_m, 0.0) if strokes else (0.0,)):
        # As the patch lies, so that its outline is a rectangle there.
        R = matmul(kin.rot_z(aligned + turn), R_now)
        lying = matmul(kin.transform(matmul(kin.rot_z(-patch.yaw), R), (0.0, 0.0, 0.0)), to_tcp)
        boxes = np.stack([s.moved(lying).aabb() for s in held.solids])
        low = boxes[:, 0].min(0)
        underside = boxes[boxes[:, 0, 2] < low[2] + _PATCHES.top_m]
        middle = (underside[:, 0].min(0) + underside[:, 1].max(0))[:2] / 2
        reach = (underside[:, 1].max(0) - underside[:, 0].min(0))[:2] / 2
        off = matmul(kin.rot_z(patch.yaw)[:2, :2], middle)
        poses = []
        for k, at in enumerate(strokes_over(patch.half + past, reach) if strokes else [np.zeros(2)]):
            x, y = patch.middle[:2] + matmul(kin.rot_z(patch.yaw)[:2, :2], at) - off
            T = matmul(kin.transform(R, (x, y, patch.middle[2] + height - low[2])), to_tcp)
            poses += [T] if k else [_raised(T), T]
        poses.append(_raised(poses[-1]))
        yield Option(
            np.stack(poses),
            1,
            _STROKES.turn_cost * abs(float(kin.wrap(aligned + turn))) + _STROKES.past_cost * (_STROKES.past_m - past),
        )


def _raised(T: Array) -> Array:
    return kin.transform(T[:3, :3], T[:3, 3] + [0.0, 0.0, OVER_M])


def strokes_over(half: Array, reach: Array) -> list[Array]:
    """Turning points (2,) [m] of a way there and back that takes a tool over a patch, about their middles.

    Args:
        half: (2,) half sizes of the patch.
        reach: (2,) half sizes of the tool, turned as the patch; where it is larger it stays in the middle.
    """
    rest = half - np.minimum(reach, half)
    lanes = int(np.ceil(rest[1] / (_STROKES.lanes * reach[1]))) + 1 if rest[1] > 0 else 1
    points = []
    for lane, y in enumerate(np.linspace(-rest[1], rest[1], lanes) if lanes > 1 else [0.0]):
        ends = (-rest[0], rest[0]) if lane % 2 == 0 else (rest[0], -rest[0])
        points += [np.array([x, y]) for x in (ends if rest[0] > 0 else ends[:1])]
    return points
