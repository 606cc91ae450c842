"""What the hands hold, told by touch: the name of the payload, its place, and its solids for skills.

A payload moves with the hand and stays where the hand releases it. `handling` (for a policy) and `carrying` (for the
navigator) decide which known thing it is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Generic, Literal, Protocol, Self, TypeVar

import numpy as np

from mpvi_bt.finding.scene.scene import Scene
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.ground.robot.collision import Load
from mpvi_bt.ground.robot.protocol import SIDES, Proprioception, Side
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.ground.robot.squeeze import squeezes

Hand = Literal["left", "right", "both"]
HANDS: tuple[Hand, Hand, Hand] = ("left", "right", "both")


@dataclass(frozen=True)
class Touch:
    """How touch tells what the hands take.

    Our choice: sooner than the arm comes to rest, and not while the fingers still move. A hand closes on what it was
    led to. Shapes are off by some centimeters, boxes about things that were seen from one side by more, those of large
    things by most.
    """

    steady_m: float = 0.0005  # fingers that move less in a step are steady [m]
    steady_steps: int = 3  # steady steps in a row of fingers that have met something
    grasped_m: float = 0.08  # largest distance from a hand to what it takes [m]
    pressed_m: float = 0.15  # largest distance from two hands to what they press [m]
    outer: float = 1.2  # least floor area of the container of a thing [ratio of the thing's]

    def reach_m(self, hand: Hand) -> float:
        """From a hand, or the farther one of both, to what it takes, at the most."""
        return self.pressed_m if hand == "both" else self.grasped_m


TOUCH = Touch()


class Movable(Protocol):
    """What is known of a thing: a shape, or a box about it."""

    def moved(self, M: Array, /) -> Self:
        """The same, carried along by the motion `M` (4, 4) of the world frame into itself."""
        ...


Body = TypeVar("Body", bound=Movable)


@dataclass(frozen=True, eq=False)
class Carried(Generic[Body]):
    """A thing that a hand carries, as it was when it came to be carried.

    Attributes:
        body: What it was then. Kept so: a box about a turned box, turned again, grows each time.
        T_tcp_world: (4, 4) inverse of the hand's pose then; of both hands the left one's counts.
    """

    body: Body
    T_tcp_world: Array


@dataclass(eq=False)
class Grip(Generic[Body]):
    """What a hand took.

    Attributes:
        name: As it is known; None: nobody knows it.
        loads: It and what is in it, by name.
    """

    name: str | None
    loads: dict[str, Carried[Body]] = field(default_factory=dict)


class HandTracker(Generic[Body]):
    """Tells by proprioception alone when hands take and release something, and where their payloads are.

    It does not decide which thing a hand takes: `take` is told.

    Attributes:
        grips: What each hand, and both between them, hold.
        felt: The last control step.
        width: How far the fingers of each hand stood apart in the last step [m],
        steady: and in how many steps, one after the other, they have not moved.
    """

    def __init__(self) -> None:
        """Hold nothing."""
        self.grips: dict[Hand, Grip[Body]] = {}
        self.width: dict[Side, float] = {}
        self.steady: dict[Side, int] = {}
        self.felt: Proprioception | None = None
        self._tcps: dict[Hand, Array] = {}

    def be(self, felt: Proprioception) -> None:
        """Know where the hands are now."""
        self.felt, self._tcps = felt, {}

    def feel(self, felt: Proprioception) -> Iterator[tuple[Hand, bool]]:
        """Take in one control step; the same one again changes nothing.

        Yields:
            Each hand that begins to hold something, with true, or ceases to: `take` and `release` follow.
        """
        again = felt is self.felt
        self.be(felt)
        for side in felt.sides:
            width, holds = felt.gripper_width[side], felt.holds(side)
            if not again:  # of fingers that are felt for the first time nothing says that they move
                still = abs(width - self.width.get(side, width)) < TOUCH.steady_m
                self.steady[side] = self.steady.get(side, TOUCH.steady_steps) + 1 if still else 0
            self.width[side] = width
            if holds != (side in self.grips) and (not holds or self.steady[side] >= TOUCH.steady_steps):
                yield side, holds
        if (pressed := squeezes(felt)) != ("both" in self.grips):
            yield "both", pressed

    def tcps(self, hand: Hand) -> Array:
        """T_world_tcp (1 or 2, 4, 4) of a hand, or of both, the left one's first, as felt."""
        if hand not in self._tcps:
            assert self.felt is not None
            felt, robot, sides = self.felt, robot_named(self.felt.robot), SIDES if hand == "both" else (hand,)
            tcps = np.stack([robot.tcp(felt.torso, felt.arm[side], side) for side in sides])
            self._tcps[hand] = matmul(kin.base(felt.base_pose), tcps)
        return self._tcps[hand]

    def take(self, hand: Hand, name: str | None) -> None:
        """Let a hand hold a thing; None: an unknown one. `load` says where it is."""
        if name is not None:
            self.take_out(name)
        self.grips[hand] = Grip(name)

    def take_out(self, name: str) -> None:
        """A thing is no longer in what hands hold."""
        for grip in self.grips.values():
            if grip.name != name:
                grip.loads.pop(name, None)

    def load(self, hand: Hand, name: str, body: Body) -> None:
        """A thing, which is as `body` says now, moves with a hand from now on."""
        self.grips[hand].loads[name] = Carried(body, kin.inverse(self.tcps(hand)[0]))

    def release(self, hand: Hand) -> Grip[Body]:
        """Mark a hand as empty. Returns its last grip, with the payload as it was when taken."""
        return self.grips.pop(hand)

    def held(self, hand: Hand) -> str | None:
        """The payload of a hand; None if there is none, or if nobody knows it."""
        return self.grips[hand].name if hand in self.grips else None

    def names(self) -> set[str]:
        """All that the hands hold."""
        return {grip.name for grip in self.grips.values() if grip.name is not None}

    def holder(self, name: str) -> Hand | None:
        """The hand that holds a thing; if both hold it, the earlier one."""
        return next((hand for hand, grip in self.grips.items() if grip.name == name), None)

    def carried(self, name: str) -> Body | None:
        """A thing that the hands carry, as it is now; None if they do not."""
        for hand, grip in self.grips.items():
            if (load := grip.loads.get(name)) is not None:
                return load.body.moved(matmul(self.tcps(hand)[0], load.T_tcp_world))
        return None


def falls_into(center: Array, rooms: Sequence[Array]) -> int | None:
    """Index of the room for a falling thing (a container volume): the highest one that is open below the thing.

    Args:
        center: (3,) the thing's middle.
        rooms: (2, 3) lowest and highest corner of each.
    """
    below = [k for k, (low, high) in enumerate(rooms) if (center > low).all() and (center[:2] < high[:2]).all()]
    return max(below, key=lambda k: float(rooms[k][1, 2]), default=None)


@dataclass(frozen=True, eq=False)
class Held:
    """What a hand holds.

    Attributes:
        name: The thing.
        side: The hand.
        T_tcp_thing: (4, 4).
        solids: Of it and what lies in it, in the tcp frame.
        load: The same, for collision checks.
        laden: Whether something lies in it or on it, which falls out if it is tipped.
    """

    name: str
    side: Side
    T_tcp_thing: Array
    solids: tuple[Solid, ...]
    load: Load
    laden: bool = False

    @classmethod
    def of(cls, scene: Scene, side: Side, T_world_tcp: Array) -> Held | None:
        """The payload of a hand at `T_world_tcp` (4, 4), with its contents; None if the hand is empty."""
        if (name := scene.holding(side)) is None:
            return None
        frame = kin.inverse(T_world_tcp)
        solids = tuple(s.moved(frame) for n in (name, *scene.within(name)) for s in scene.solids(n))
        load = Load(solids, [v.moved(frame) for v in scene.volumes(name)])
        return cls(name, side, matmul(frame, scene.pose(name)), solids, load, scene.laden(name))
