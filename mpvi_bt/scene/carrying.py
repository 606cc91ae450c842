"""What the hands hold of what is known, by touch: it moves with them, and is put where they let go of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, cast

import numpy as np

from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.linear_algebra import matmul, norm
from mpvi_bt.robot.protocol import SIDES, Proprioception
from mpvi_bt.robot.solids import Array
from mpvi_bt.robot.squeeze import squeezes
from mpvi_bt.scene.knowledge import Entry, KnowledgeBase, laid_down
from mpvi_bt.scene.touch import BY_BOX, tcp

Hand = Literal["left", "right", "both"]
HANDS: tuple[Hand, Hand, Hand] = ("left", "right", "both")

PUT = 0.6  # our choice: what was let go is believed to be where it was, until it is seen: not more than so


@dataclass(frozen=True)
class Fingers:
    """When fingers have met something.

    Our choice: sooner than the arm comes to rest, and not while they still move.

    Attributes:
        steady_m: Fingers that move less than that in a step [m],
        steady_steps: so many steps in a row, have met something.
    """

    steady_m: float = 0.0005
    steady_steps: int = 3


_FINGERS = Fingers()


@dataclass(frozen=True, eq=False)
class Load:
    """A thing that a hand carries, as it was when it came to be carried.

    Attributes:
        box: (2, 3) lowest and highest corner then. Kept so: a box about a turned box, turned again, grows each time.
        T_tcp_world: (4, 4) inverse of the hand's pose then; of both hands the left one's counts.
    """

    box: Array
    T_tcp_world: Array


@dataclass(eq=False)
class Grip:
    """What a hand took.

    Attributes:
        name: The entry's.
        loads: It and what is in it, by name.
    """

    name: str
    loads: dict[str, Load]


class Carrying:
    """Follows what is held through a knowledge base, told by proprioception alone.

    Attributes:
        grips: What each hand holds that is known; None for something that nobody knows.
    """

    def __init__(self, knowledge: KnowledgeBase) -> None:
        """Hold nothing."""
        self._knowledge = knowledge
        self.grips: dict[Hand, Grip | None] = {}
        self._width: dict[str, float] = {}
        self._steady = dict.fromkeys(SIDES, 0)
        self._took: dict[Hand, Array] = {}  # where (3,) hands took what nobody knows,
        self._left: list[Array] = []  # and where they left it, elsewhere

    def feel(self, body: Proprioception) -> list[str]:
        """Take in one step of proprioception. Returns the names of what was let go."""
        let_go = []
        for side in body.sides:
            width = body.gripper_width[side]
            still = abs(width - self._width.get(side, np.inf)) < _FINGERS.steady_m
            self._steady[side], self._width[side] = self._steady[side] + 1 if still else 0, width
            holds = body.holds(side)
            if side in self.grips and not holds:
                let_go += self._release(side, body)
            elif holds and side not in self.grips and self._steady[side] >= _FINGERS.steady_steps:
                self._take(side, body, self._knowledge)
        pressed = squeezes(body)
        if "both" in self.grips and not pressed:
            let_go += self._release("both", body)
        elif pressed and "both" not in self.grips:
            self._take("both", body, self._knowledge)
        self.move(body)
        return let_go

    def move(self, body: Proprioception) -> None:
        """Bring what is held to where the hands are now."""
        moved: set[str] = set()
        for hand, grip in self.grips.items():
            if grip is None or grip.name in moved:
                continue
            moved.add(grip.name)
            T = _tcps(hand, body)[0]
            for name, load in grip.loads.items():
                entry = self._knowledge.entries.get(name)
                if entry is not None and grip.name in (entry.name, entry.inside):
                    entry.lowest, entry.highest = _moved(load.box, matmul(T, load.T_tcp_world))

    def adopt(self, entries: Iterable[Entry], body: Proprioception) -> None:
        """Let hands that hold something unknown hold what was just found in them; what they left was laid down."""
        found = list(entries)
        for hand in [hand for hand, grip in self.grips.items() if grip is None]:
            self._take(hand, body, found)
        for entry in found:
            gaps = [np.abs(p - np.clip(p, entry.lowest, entry.highest))[:2].max() for p in self._left]
            if entry.kind == "object" and not entry.held and min(gaps, default=np.inf) < BY_BOX.grasped_m:
                entry.laid = True

    def sort(self, body: Proprioception) -> None:
        """Tell anew what is in what: in the smallest movable thing in whose box its middle is; but for what is held."""
        things = [entry for entry in self._knowledge if entry.kind == "object"]
        if not things:
            return
        lows, highs = (np.stack([getattr(e, corner) for e in things]) for corner in ("lowest", "highest"))
        centers, floors = (lows + highs) / 2, np.prod(highs - lows, axis=1, where=[True, True, False])
        within = ((centers[:, None] >= lows) & (centers[:, None] <= highs)).all(-1)
        within &= floors > BY_BOX.outer * floors[:, None]
        nearest = np.where(within, floors, np.inf).argmin(1)
        for i, entry in enumerate(things):
            if not entry.held:
                entry.inside = None
                if within[i].any():
                    self._put_in(entry, things[nearest[i]], body)

    def _put_in(self, entry: Entry, container: Entry, body: Proprioception) -> None:
        """Know a thing to be in a container, and carried along with it from now on if that is held."""
        entry.inside = container.name
        if (hand := self._holding(container.name)) is not None:
            self._load(hand, entry, body)

    # ------------------------------------------------------------------------------------------ hands

    def _take(self, hand: Hand, body: Proprioception, among: Iterable[Entry]) -> None:
        """A hand has begun to hold something: the nearest thing, if one is known near it."""
        reach = BY_BOX.pressed_m if hand == "both" else BY_BOX.grasped_m
        points = np.stack([T[:3, 3] for T in _tcps(hand, body)])
        near = []
        for entry in among:
            if entry.kind == "object":
                gap = float(norm(points - np.clip(points, entry.lowest, entry.highest), axis=1).max())
                if gap < reach:  # of things in one another the one whose middle is near, too
                    near.append((gap + float(norm(points.mean(0) - entry.center)) / 2, entry.name))
        if not near:
            self.grips[hand] = None
            self._took.setdefault(hand, points.mean(0))
            return
        self._took.pop(hand, None)
        entry = self._knowledge.entries[min(near)[1]]
        entry.inside = None
        self.grips[hand] = Grip(entry.name, {})
        for one in self._with_contents(entry.name):
            self._load(hand, one, body)

    def _load(self, hand: Hand, entry: Entry, body: Proprioception) -> None:
        """Know a thing to be carried from now on, with what the hand holds."""
        grip = self.grips[hand]
        assert grip is not None
        entry.held = True
        grip.loads[entry.name] = Load(np.stack([entry.lowest, entry.highest]), kin.inverse(_tcps(hand, body)[0]))

    def _release(self, hand: Hand, body: Proprioception) -> list[str]:
        """A hand has let go, or lost what it held. Returns the names of what is held no more."""
        self.move(body)
        grip = self.grips.pop(hand)
        if (took := self._took.pop(hand, None)) is not None:
            left = np.mean([T[:3, 3] for T in _tcps(hand, body)], axis=0)
            self._left += [left] if laid_down(took, left, left, by_hand=True) else []
        if grip is None or grip.name not in self._knowledge.entries or self._holding(grip.name) is not None:
            return []
        entry = self._knowledge.entries[grip.name]
        carried = self._with_contents(grip.name)
        for one in carried:
            one.held, one.confidence = False, min(one.confidence, PUT)
        taken_at = grip.loads[grip.name].box.mean(0)
        entry.laid = laid_down(taken_at, entry.lowest, entry.highest, by_hand=True)
        self._fall(entry, body)
        if (into := self._knowledge.entries.get(entry.inside or "")) is not None:
            off = (taken_at < into.lowest) | (taken_at > into.highest)
            entry.laid |= bool(off[:2].any())  # however near: it was not taken out of that
        return [one.name for one in carried]

    def _fall(self, entry: Entry, body: Proprioception) -> None:
        """Put what was let go over a container into it.

        Our choice: a movable thing that covers more floor and is half as high counts as one. What is let go over its
        rim comes to lie within it; how deep shows when it is seen.
        """
        center, height = entry.center, float(np.ptp([entry.lowest[2], entry.highest[2]]))
        over = [
            c
            for c in self._knowledge
            if c.kind == "object" and c is not entry and c.inside != entry.name
            and _floor(c) > BY_BOX.outer * _floor(entry)
            and (center[:2] >= c.lowest[:2]).all() and (center[:2] <= c.highest[:2]).all()
            and center[2] > c.lowest[2] and c.highest[2] - c.lowest[2] > height / 2
        ]  # fmt: skip
        if not over:
            return
        container = max(over, key=lambda c: float(c.highest[2]))
        drop = np.array([0.0, 0.0, max(float(entry.highest[2] - container.highest[2]), 0.0)])
        for one in self._with_contents(entry.name):
            one.lowest, one.highest = one.lowest - drop, one.highest - drop
        self._put_in(entry, container, body)

    def _holding(self, name: str) -> Hand | None:
        """The hand that holds an entry."""
        return next((hand for hand, grip in self.grips.items() if grip is not None and grip.name == name), None)

    def _with_contents(self, name: str) -> list[Entry]:
        """An entry, if it is still known, and what is in it."""
        return [e for e in self._knowledge if e.name == name or e.inside == name]

    # ------------------------------------------------------------------------------------------ saving

    def save(self) -> dict[str, Any]:
        """How the hands are, as JSON values."""
        return {
            "width": dict(self._width),
            "steady": dict(self._steady),
            "took": {hand: place.tolist() for hand, place in self._took.items()},
            "left": [place.tolist() for place in self._left],
            "grips": {
                hand: grip and {
                    "name": grip.name,
                    "loads": {n: {"box": a.box.tolist(), "T": a.T_tcp_world.tolist()} for n, a in grip.loads.items()},
                }
                for hand, grip in self.grips.items()
            },
        }  # fmt: skip

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Bring the hands to what was saved.

        Raises:
            KeyError, TypeError, ValueError: What was saved is not as `save` writes it.
        """
        grips: dict[Hand, Grip | None] = {}
        for hand, grip in saved["grips"].items():
            if hand not in HANDS:
                raise ValueError(f"there is no hand {hand!r:.40}")
            loads = grip and {
                str(name): Load(_array(load["box"], (2, 3)), _array(load["T"], (4, 4)))
                for name, load in grip["loads"].items()
            }
            grips[cast("Hand", hand)] = grip and Grip(str(grip["name"]), loads)
        self._width = {side: float(saved["width"][side]) for side in SIDES if side in saved["width"]}
        self._steady = {side: int(saved["steady"][side]) for side in SIDES}
        self._took = {cast("Hand", hand): _array(place, (3,)) for hand, place in saved["took"].items()}
        self._left = [_array(place, (3,)) for place in saved["left"]]
        self.grips = grips


def _tcps(hand: Hand, body: Proprioception) -> list[Array]:
    """T_world_tcp (4, 4) of a hand, or of both."""
    return [tcp(body, side) for side in (SIDES if hand == "both" else (hand,))]


def _moved(box: Array, motion: Array) -> tuple[Array, Array]:
    """The axis-aligned box about a box (2, 3) that is carried along by `motion` (4, 4)."""
    center, half = box.mean(0), (box[1] - box[0]) / 2
    center, half = matmul(motion[:3, :3], center) + motion[:3, 3], matmul(np.abs(motion[:3, :3]), half)
    return center - half, center + half


def _floor(entry: Entry) -> float:
    """The floor that a thing covers [m^2]."""
    return float(np.prod((entry.highest - entry.lowest)[:2]))


def _array(given: Any, shape: tuple[int, ...]) -> Array:
    array = np.array(given, float)
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"{shape} finite numbers are due, not {given!r:.60}")
    return array
