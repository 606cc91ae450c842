"""Cutting: the blade of a held tool comes down on a thing, which falls into halves, and the halves into dice."""

from __future__ import annotations

import re
from collections.abc import Collection, Generator, Iterator
from dataclasses import dataclass, replace

import numpy as np

from mpvi_bt.finding.scene.hands import Held
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array, Solid, bounds
from mpvi_bt.ground.robot.motion import Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.motion.approach import FEEL, close_in, going_around, leave, lines, take_up, withdraw
from mpvi_bt.hands.motion.carry import settle
from mpvi_bt.hands.motion.gaze import study
from mpvi_bt.hands.motion.work import Words, Work
from mpvi_bt.hands.skills.pour import TURNS_RAD, righted
from mpvi_bt.hands.skills.wipe import OVER_M, tool_hand
from mpvi_bt.hands.stance.stance import Option, Stance
from mpvi_bt.hands.stance.stance_search import Search


@dataclass(frozen=True)
class Cutting:
    """How a blade comes down on a thing."""

    into_m: float = 0.015  # target of the blade below the thing's top [m]; the arm's give makes it a force; our choice
    beside_m: float = 0.05  # things this close to the cut, such as the board under it, may be touched [m]; our choice
    again_s: float = 2.2  # time between two cuts [s]; OmniGibson's slicers are active again 2.0 s after a contact
    pieces: int = 8  # most pieces that one call cuts a thing into; our choice
    turn_cost: float = 0.05  # cost of each radian of the tool's turn about the vertical; our choice


_CUT = Cutting()
_NEXT = ("not_cut", "no_stance")  # reasons of one piece, which are none to leave the others whole
_WHICH = re.compile(r"^(?:(?:the|an?|last|other|another|both) )+")


def cut(work: Work, words: Words, tried: list[Array]) -> Actions:
    """Cut what `words["object"]` names in two with a held tool, `words["tool"]` if that is said.

    Raises:
        MotionFailure: "not_held", "unknown_object", "no_stance", "dropped", "not_cut", or a motion's own reason.
    """
    side, name = tool_hand(work, words), work.nearest(words.get("object", ""), words.get("surface"))
    yield from _press(work, side, name, tried)
    yield from settle(work, without={name})


def dice(work: Work, words: Words, tried: list[Array]) -> Actions:
    """As `cut`, and each half again as soon as the blade cuts anew; only the halves, where nothing whole is left.

    Raises:
        MotionFailure: As `cut`; "not_cut" and "no_stance" once all else is cut.
    """
    side, phrase = tool_hand(work, words), words.get("object", "")
    halves = _halves(work, phrase)
    if not halves or work.scene.knowledge().find(phrase):
        halves = [work.nearest(phrase, words.get("surface"))]
    left, missed, tended, first = halves, None, set[str](), 0
    while left and len(tended) < _CUT.pieces:
        piece = left[0]
        tended.add(piece)
        try:
            first = yield from _press(work, side, piece, tried, first)
        except MotionFailure as failure:
            if failure.reason not in _NEXT:
                raise
            missed = failure
        left = [half for half in _halves(work, phrase) if half not in tended]
        yield from work.motion.wait(_CUT.again_s if left else 0.0)
    yield from settle(work, without=tended)
    if missed is not None:
        raise missed


def half_of(phrase: str) -> str:
    """What a half of it is called: "half apple", of "another apple"."""
    return f"half {_WHICH.sub('', phrase)}"


def _halves(work: Work, phrase: str) -> list[str]:
    """What there is of halves of what a phrase names."""
    return [entry.name for entry in work.scene.knowledge().find(half_of(phrase))]


def _press(work: Work, side: Side, name: str, tried: list[Array], first: int = 0) -> Generator[Array, None, int]:
    """Bring the blade down on a thing; of a tool that is known as one piece, the one half of it and then the other.

    `first` is which of them to begin with, and what is returned which of them cut.

    Raises:
        MotionFailure: "not_cut" if the thing is known to be whole still, "dropped", "no_stance", or a motion's own.
    """
    blades = _blades(work.load(side))
    for k in sorted(range(len(blades)), key=lambda k: k != first):
        yield from _stroke(work, side, name, blades[k], tried)
        if not work.gripped(side):
            raise MotionFailure("dropped")
        yield from study(work, name)
        if name not in work.scene.knowledge().entries:
            return k
    raise MotionFailure("not_cut")


def _blades(held: Held) -> list[Solid]:
    """What may be the blade, in the tool's frame: the part farthest from the hand, or either half of the only part."""
    to_tool = kin.inverse(held.T_tcp_thing)
    far = max(held.solids, key=lambda s: float(norm(s.T[:3, 3])))
    if len(held.solids) > 1 or far.kind != "box":
        return [far.moved(to_tool)]
    long = int(far.half_m.argmax())
    half_m = np.where(np.arange(3) == long, far.half_m / 2, far.half_m)
    offsets = (sign * half_m[long] * far.T[:3, long] for sign in (1.0, -1.0))
    moved = (kin.transform(far.T[:3, :3], far.T[:3, 3] + offset) for offset in offsets)
    return [replace(far, half_m=half_m, T=T).moved(to_tool) for T in moved]


def _stroke(work: Work, side: Side, name: str, blade: Solid, tried: list[Array]) -> Actions:
    """Bring a blade down on a thing, and leave. Raises MotionFailure "no_stance", or a motion's own reason."""
    beside = _beside(work, name)

    def find(search: Search, here_first: bool) -> Stance | None:
        return search.find(work.middle(name)[:2], list(_options(work, work.load(side), name, blade)), here_first)

    search = work.search(side, beside)
    stance = find(search, True)
    if stance is None:
        stance, search = yield from going_around(work, name, lambda: close_in(work, side, beside, name, find, tried))
    try:
        yield from take_up(work, stance, search)
        T = matmul(kin.inverse(work.base), kin.base(stance.base), stance.waypoints[1])
        yield from work.motion.line(side, T, FEEL.speed_m_s, until_contact=True)
    except MotionFailure:
        yield from withdraw(work, side, stance)
        raise
    yield from lines(work, side, stance, [0])
    yield from leave(work, stance)


def _options(work: Work, held: Held, name: str, blade: Solid) -> Iterator[Option]:
    """Ways of the hand: the tool level, its blade over the middle of a thing, and down onto it."""
    low, high = bounds(work.scene.solids(name))
    T_now = work.scene.pose(held.name)
    up = int(np.abs(T_now[2, :3]).argmax())
    R_now = righted(T_now, T_now[:3, up] * np.sign(T_now[2, up]))[:3, :3]
    to_tcp = kin.inverse(held.T_tcp_thing)
    for turn in TURNS_RAD:
        R = matmul(kin.rot_z(turn), R_now)
        edge_low, edge_high = blade.moved(kin.transform(R, np.zeros(3))).aabb()
        edge = np.array([*(edge_low + edge_high)[:2] / 2, edge_low[2]])
        poses = [
            matmul(kin.transform(R, np.array([*(low + high)[:2] / 2, high[2] + over]) - edge), to_tcp)
            for over in (OVER_M, -_CUT.into_m)
        ]
        yield Option(np.stack(poses), 1, _CUT.turn_cost * abs(float(kin.wrap(turn))))


def _beside(work: Work, name: str) -> Collection[str]:
    """A thing, and the movable ones about it."""
    low, high = bounds(work.scene.solids(name))
    near = (e for e in work.scene.knowledge() if e.kind == "object" and not e.held)
    return {name} | {
        e.name for e in near if (e.lowest < high + _CUT.beside_m).all() and (low - _CUT.beside_m < e.highest).all()
    }
