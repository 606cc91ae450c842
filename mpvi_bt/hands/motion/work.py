"""What every scripted skill works with: what is known of the world, the robot's motion, what the hands hold."""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar, cast

import numpy as np

from mpvi_bt.executive.plan.knowledge import Entry
from mpvi_bt.finding.scene.hands import Held
from mpvi_bt.finding.scene.scene import Scene
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array, Solid, bounds
from mpvi_bt.ground.robot.collision import Body, Obstacles, Surroundings, Together
from mpvi_bt.ground.robot.motion import Actions, Motion, MotionFailure
from mpvi_bt.ground.robot.protocol import SIDES, CameraImage, Side
from mpvi_bt.ground.words.phrases import OTHER, normalize, read
from mpvi_bt.hands.stance.effort import Effort
from mpvi_bt.hands.stance.refusals import Refusals, deepest
from mpvi_bt.hands.stance.stance_search import Search

_Answer = TypeVar("_Answer")
Words = Mapping[str, str]  # what fills the slots of a skill call, such as {"object": "can of soda"}

NEAR_M = 1.7  # our choice, an arm and a stride: solids farther from the robot than this do not matter to a skill
SAME_M = 3.0  # our choice, a room's width: what a phrase has named this near to the robot it names again
LIFTED_M = 0.10  # our choice: a hand that rises by that is clear of what stands beside
_RISES = (1.0, 0.5, 0.25)  # our choice: shares of it, where a board hangs low


@dataclass(frozen=True)
class Nearness:
    """What is near, and what lies where.

    Our choice, by errors of boxes about things.
    """

    base_m: float = 0.2  # added radius of the base's spheres, which then reach into the floor [m]
    beside_m: float = 0.03  # a thing this close to a sphere is what it meets [m]
    alike: int = 3  # decimals to which a robot that stands still is told the same [rad]
    alike_base: int = 2  # decimals to which its base is felt to stand where it stood [m, rad]
    on_m: float = 0.03  # a thing on another one is at most this far above its top, or below its bottom [m]


_WORK = Nearness()
AJAR = 0.3  # our choice, of its limit: a door that stands open so far is seen to be open, from wherever that is
EASY_M = 0.9  # our choice: height above the floor where hands reach farthest


@dataclass(eq=False)
class Work:
    """One skill's view of robot and world.

    Attributes:
        scene: What is known of the world.
        motion: The robot's command, as the skill changes it.
        rng: Randomness of planning.
        wanted: Cameras whose pictures the next step has to bring.
        images: The pictures that it brought.
        effort: What searches may take.
        refusals: What candidates of searches died of since the attempt began.
        ajar: Out of what front (3,) of things a door was last seen to stand open, by name.
        lay: Where things were when a hand closed on them: x, y of their frames, height of their lowest points [m].
        bearings: Directions in the world [rad] that words such as "left" had when they were first heeded.
        meant: What phrases for where things go have named so far.
        grasped: How each hand was turned (3, 3) in the world when it last closed on something.
        studied: What was looked at closely last, and how base and arms stood then.
        views: How often a look may have shown something new: the robot stood otherwise than at the one before.
    """

    scene: Scene
    motion: Motion
    rng: np.random.Generator
    wanted: tuple[str, ...] = ()
    images: Mapping[str, CameraImage] = field(default_factory=dict)
    effort: Effort = field(default_factory=Effort)
    refusals: Refusals = field(default_factory=Refusals)
    ajar: dict[str, Array] = field(default_factory=dict)
    lay: dict[str, Array] = field(default_factory=dict)
    bearings: dict[str, float] = field(default_factory=dict)
    meant: dict[str, str] = field(default_factory=dict)
    grasped: dict[Side, Array] = field(default_factory=dict)
    studied: tuple[str | None, Array] | None = None
    views: int = 0
    _viewed: dict[tuple[str, ...], bytes] = field(default_factory=dict)
    _answers: dict[Hashable, object] = field(default_factory=dict)
    _answered: tuple[object, ...] | None = None

    @property
    def stands(self) -> bytes:
        """How the robot stands: the same as long as it does not move."""
        told = self.motion.action.copy()
        self.motion.layout.set_velocity(told, 0.0)
        at = np.concatenate([np.round(told, _WORK.alike), np.round(self.motion.felt.base_pose, _WORK.alike_base)])
        return (at + 0.0).tobytes()  # no sign of a zero

    def once(self, question: Hashable, search: Callable[[], _Answer]) -> _Answer:
        """What a search finds. It is not repeated while the robot stands as it does and sees and holds nothing new."""
        if self._answered != (now := (self.stands, self.views, self.in_hands())):
            self._answers, self._answered = {}, now
        if question not in self._answers:
            self._answers[question] = search()
        return cast("_Answer", self._answers[question])

    @property
    def base(self) -> Array:
        """T_world_base (4, 4) as felt."""
        return kin.base(self.motion.felt.base_pose)

    def hand(self, side: Side) -> Array:
        """T_world_tcp (4, 4) as felt."""
        felt = self.motion.felt
        return np.asarray(matmul(self.base, self.motion.robot.tcp(felt.torso, felt.arm[side], side)))

    def see(self, *cameras: str) -> Actions:
        """Take one picture with each camera, the robot standing still; nothing where the scene needs no looks."""
        if self.scene.needs_looks:
            self.wanted = cameras
            yield self.motion.still()
            self.wanted = ()
            self.scene.see({c: self.images[c] for c in cameras}, self.motion.felt)
            if self._viewed.get(cameras) != (now := self.stands):
                self._viewed[cameras] = now
                self.views += 1
                self.effort.failed.clear()  # there may be room where there seemed to be none

    def middle(self, name: str) -> Array:
        """(3,) the middle of the box about a thing, in the world.

        Raises:
            MotionFailure: "unknown_object" if it is no more, as a log that was chopped.
        """
        try:
            solids = self.scene.solids(name)
        except KeyError:
            raise MotionFailure("unknown_object") from None
        return np.asarray(bounds(solids).mean(0))

    def nearest(self, phrase: str, source: str | None = None, ajar: bool = False) -> str:
        """The first of those that a phrase names, as `alike` orders them. Raises as `alike`."""
        return self.alike(phrase, source, ajar)[0]

    def same(self, phrase: str, ajar: bool = False, content: str | None = None) -> str:
        """The first of `alike`, but what a phrase has named it names again while near; "another" names one of the rest.

        Of two bookcases side by side "the bookcase" is that in which the first thing was put, as in a person's words.

        Raises:
            MotionFailure: As `alike`.
        """
        names, said = self.alike(phrase, None, ajar, content), normalize(OTHER.sub("", phrase))
        before, here = self.meant.get(said), self.motion.felt.base_pose[:2]
        if before in names and norm(self.middle(before)[:2] - here) < SAME_M:
            names.sort(key=lambda name: (name == before) == bool(OTHER.match(phrase)))
        self.meant[said] = names[0]
        return names[0]

    def alike(
        self, phrase: str, source: str | None = None, ajar: bool = False, content: str | None = None
    ) -> list[str]:
        """The things that a phrase names, of those that are still to be picked up, if there are any.

        The nearest comes first. Our choice: nearest to where the base is, at a comfortable height for the hands. Of two
        cabinets, one above the other, they reach far into the lower one only.

        Args:
            phrase: What they are called.
            source: What they are said to be in or on; where nothing so called is there, they may be anywhere.
            ajar: What stands open in the same room comes before what is nearer and shut: to put something in, or to
                close it.
            content: What is to be found in or on them; where none is known to have that, it may be any of them.

        Raises:
            MotionFailure: "unknown_object" if nothing is called so.
        """
        known = self.scene.knowledge()
        found = known.find(phrase)
        if not found:
            raise MotionFailure("unknown_object")
        here = self.motion.felt.base_pose[:2]
        if source is not None:
            places = known.find(source)
            found = [e for e in found if any(_there(e, place) for place in places)] or found
        if content is not None:
            things = known.find(content)
            found = [e for e in found if any(_there(thing, e) for thing in things)] or found
        found = self._as_said(found, phrase, ajar)
        some = [e for e in found if known.away(e) == known.away(found[0])]
        if ajar and len(some) > 1:
            near = [e for e in some if norm(e.center[:2] - here) < SAME_M]
            some = [e for e in near if self.stands_open(e.name)] or some
        hands = np.append(here, EASY_M)
        return [e.name for e in sorted(some, key=lambda e: float(norm(e.center - hands)))]

    def _as_said(self, found: list[Entry], phrase: str, ajar: bool) -> list[Entry]:
        """Those that are empty, open or shut, or with something in them, where a phrase says so; all if none is."""
        looked_into = None if ajar else self.stands_open  # where something is put, or what is to be shut, stands open
        fitting = self.scene.knowledge().filled_so(found, phrase, self.scene.within, looked_into)
        reading = read(phrase)
        if reading is not None and (state := dict(reading.qualities).get("state")) is not None:
            fitting = [e for e in fitting if self.stands_open(e.name) == (state == "open")] or fitting
        return fitting

    def stands_open(self, name: str) -> bool:
        """Whether a door, drawer or lid of a thing stands open."""
        return any(door.position > AJAR * door.limit for door in self.scene.doors(name))

    def free_hands(self, name: str, wanted: str | None = None) -> list[Side]:
        """Empty hands, the one on the side of a thing first; only the one `wanted` if given.

        Raises:
            MotionFailure: "hands_full" if there is none.
        """
        free = [s for s in self.motion.robot.sides if self.scene.holding(s) is None and wanted in (None, s)]
        if not free:
            raise MotionFailure("hands_full")
        x, y, yaw = self.motion.felt.base_pose
        at = self.scene.pose(name)[:2, 3]
        leftward = -np.sin(yaw) * (at[0] - x) + np.cos(yaw) * (at[1] - y)
        return sorted(free, key=lambda s: (s == "left") != (leftward > 0))

    def hand_with(self, phrase: str, wanted: str | None = None) -> Side:
        """The hand that holds what a phrase names.

        Raises:
            MotionFailure: "not_held" if none does.
        """
        names = {e.name for e in self.scene.knowledge().find(phrase)}
        for side in SIDES:
            if self.scene.holding(side) in names and wanted in (None, side):
                return side
        raise MotionFailure("not_held")

    def held(self) -> dict[Side, Held]:
        """What each hand holds, with what lies in it."""
        held = (Held.of(self.scene, side, self.hand(side)) for side in self.motion.robot.sides)
        return {one.side: one for one in held if one is not None}

    def load(self, side: Side) -> Held:
        """What a hand holds, with what lies in it.

        Raises:
            MotionFailure: "not_held" if that is nothing, such as when it has just slipped out.
        """
        if (held := self.held().get(side)) is None:
            raise MotionFailure("not_held")
        return held

    def in_hands(self) -> set[str]:
        """What the robot holds, in one hand or between both."""
        names = [*map(self.scene.holding, SIDES), self.scene.between()]
        return {name for name in names if name is not None}

    def carried(self) -> set[str]:
        """What the robot carries, with what lies in it."""
        return {n for name in self.in_hands() for n in (name, *self.scene.within(name))}

    def along(self, name: str) -> list[str]:
        """A thing, and all in it that goes along where it is moved."""
        return [name, *self.scene.within(name), *self.scene.others(name)]

    def near(self, without: Collection[str] = ()) -> Obstacles:
        """What is in the way near the robot, in the world, but for what it carries and the things `without`."""
        without = self.carried().union(without)
        return self.with_bumps(self.scene.obstacles(self.motion.felt.base_pose[:2], NEAR_M, without=without))

    def with_bumps(self, known: Obstacles) -> Obstacles:
        """What is known to be in the way, and what else the base has met."""
        return Together([known, Surroundings(self.motion.bumps)]) if self.motion.bumps else known

    def search(self, side: Side, touched: Collection[str]) -> Search:
        """A stance search for one hand that works on the things `touched`."""
        carried = self.carried()
        own: list[Solid] = [s for n in sorted(touched) if n not in carried for s in self.scene.solids(n)]
        near, effort = self.near(touched), self.effort
        return Search(self.motion, side, self.held(), near, own, self.rng, effort=effort, refusals=self.refusals)

    def no_stance(self) -> MotionFailure:
        """That searches for a stance have found nothing since the attempt began, with what candidates died of."""
        return self.refused("no_stance", self.refusals)

    def refused(self, reason: str, refusals: Refusals) -> MotionFailure:
        """That a search has found nothing, with what its candidates died of."""
        return MotionFailure(reason, refusals.told(self._named))

    def no_free_spot(self, payload: str, place: str | None) -> MotionFailure:
        """That a payload has no room on, in or beside a place, or on the floor: its size, and what is there."""
        size = np.ptp(bounds(self.scene.solids(payload)), axis=0)
        length, width, height = 100 * np.append(np.sort(size[:2])[::-1], size[2])
        room = f"no room for {length:.0f} x {width:.0f} cm, {height:.0f} cm high"
        if place is None:
            return MotionFailure("no_free_spot", f"{room}, on the floor")
        known, carried = {e.name: e for e in self.scene.knowledge()}, self.carried()
        there = [n for n, e in known.items() if place in known and _there(e, known[place]) and n not in carried]
        return MotionFailure("no_free_spot", f"{room}, at {place}" + (f" with {', '.join(there)}" if there else ""))

    def explained(self, failure: MotionFailure) -> MotionFailure:
        """A failure with evidence of its own: where the base is held up, what is nearest to it there."""
        if failure.reason != "base_blocked":
            return failure
        standing, T = self.motion.robot.hull.standing, self.base
        centers = matmul(standing[:, :3], T[:3, :3].T) + T[:3, 3]
        nearest = self._named(deepest(self.near(), centers, standing[:, 3], np.eye(4)))
        return MotionFailure(failure.reason, "; ".join(filter(None, (failure.evidence, nearest and f"at {nearest}"))))

    def _named(self, sphere: Array) -> str | None:
        """What a sphere (4,) x, y, z, radius meets, the nearest first, and of several the smallest; None if unknown."""
        apart: dict[str, tuple[float, float]] = {}
        for entry in self.scene.knowledge():
            size = entry.highest - entry.lowest
            off = float(norm(np.maximum(np.abs(sphere[:3] - (entry.lowest + entry.highest) / 2) - size / 2, 0.0)))
            if entry.kind != "room" and off < sphere[3] + _WORK.beside_m:
                apart[entry.name] = off, float(np.prod(size))
        if apart:
            return min(apart, key=apart.__getitem__)
        return "floor" if sphere[2] < sphere[3] < _WORK.base_m else None

    def body(self, without: Collection[str] = ()) -> Body:
        """The robot as commanded, with what it holds, among everything near but the things `without`."""
        arms = {s: self.motion.arm(s) for s in self.motion.robot.sides}
        loads = {s: h.load for s, h in self.held().items()}
        return Body(self.motion.robot, self.motion.torso, arms, loads, self.near(without).seen_from(self.base))

    def rise(self, side: Side, by_m: float = LIFTED_M, shares: Sequence[float] = _RISES) -> Actions:
        """Raise a hand straight up, by the first of `shares` of `by_m` that the arm reaches.

        Raises:
            MotionFailure: "no_reach" if it reaches none of them, "arm_blocked" if something holds it off.
        """
        now = self.motion.hand(side)
        for share in shares:
            T = now.copy()
            T[2, 3] += share * by_m
            try:
                yield from self.motion.line(side, T)
                return
            except MotionFailure as failure:
                if failure.reason != "no_reach" or share == shares[-1]:
                    raise

    def gripped(self, side: Side) -> bool:
        """Whether the closed hand has something between its fingers, by its width."""
        return self.motion.felt.holds(side)


def _there(entry: Entry, place: Entry) -> bool:
    """Whether a thing that no hand holds is in or on another one."""
    aside = (entry.center < place.lowest) | (entry.center > place.highest)
    level = place.lowest[2] - _WORK.on_m < entry.lowest[2] < place.highest[2] + _WORK.on_m
    return not entry.held and entry is not place and bool(level) and not aside[:2].any()


# What performs a skill: work, the words of the call, and base poses tried before, to which each try adds its own.
Perform = Callable[[Work, Words, list[Array]], Actions]
