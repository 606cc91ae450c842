"""What every scripted skill works with: what is known of the world, the robot's motion, what the hands hold."""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from mpvi_bt.manipulation.effort import Effort
from mpvi_bt.manipulation.held import Held
from mpvi_bt.manipulation.scene import Scene, Sight
from mpvi_bt.manipulation.search import Search
from mpvi_bt.manipulation.site import base_clear
from mpvi_bt.manipulation.stance import Option, Stance
from mpvi_bt.robot import arm_motion, r1
from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.collision import Body, Load
from mpvi_bt.robot.motion import Actions, Motion, MotionFailure
from mpvi_bt.robot.protocol import SIDES, CameraImage, Side
from mpvi_bt.robot.solids import Array, Solid

Words = Mapping[str, str]  # what fills the slots of a skill call, such as {"object": "can of soda"}

_NEAR_M = 1.7  # solids farther from the robot than this do not matter to a skill
_LIFTED_M = 0.10
_LOOKS = 4  # at a thing that is only seen, with a drive between two
_HEAD_UP_RAD, _HEAD_DOWN_RAD = 0.5, 0.65
_FLOOR_RAD = 0.9
_EYES_M = 0.80  # a thing that much above the lift's height is well before the eyes
_ABOVE = np.array([[0.0, 0.0, z] for z in (0.2, 0.28, 0.36, 0.44)])  # a thing, where a board may be
_LEVEL_RAD = 0.3  # a head that is tilted less does not see the floor before it
_HANDS_RAD = 0.9  # so far down from the chest's horizon the head sees past the folded hands
_OVERLOOKS = ((0.42, 0.0), (0.42, 0.5), (0.42, 0.8), (0.25, 0.8), (0.25, 1.1), (0.1, 1.1))  # lift [m], pitch [rad]
_REFINED = 10  # options near the planned one that a correction may take instead
_CORRECTED = 0.8  # how far such a one may be off, see `_apart`
_INWARD_M_S = 0.25  # base speed with the arm stretched out
_FOLD_CLEAR_M = 0.02  # what is between the checks of a path may come that much nearer


@dataclass(eq=False)
class Work:
    """One skill's view of robot and world.

    Attributes:
        scene: What is known of the world.
        motion: The robot's command, as the skill changes it.
        rng: Randomness of planning.
        sight: What takes pictures in; None where the scene needs none.
        wanted: Cameras whose pictures the next step has to bring.
        images: The pictures that it brought.
        effort: What searches may take.
        ajar: Out of what front (3,) of things a door was last seen to stand open, by name.
        lay: Where things were when a hand closed on them: x, y of their frames, height of their lowest points [m].
        bearings: Directions in the world [rad] that words such as "left" had when they were first heeded.
    """

    scene: Scene
    motion: Motion
    rng: np.random.Generator
    sight: Sight | None = None
    wanted: tuple[str, ...] = ()
    images: Mapping[str, CameraImage] = field(default_factory=dict)
    effort: Effort = field(default_factory=Effort)
    ajar: dict[str, Array] = field(default_factory=dict)
    lay: dict[str, Array] = field(default_factory=dict)
    bearings: dict[str, float] = field(default_factory=dict)

    @property
    def base(self) -> Array:
        """T_world_base (4, 4) as felt."""
        return kin.base(self.motion.felt.base_pose)

    def see(self, *cameras: str) -> Actions:
        """Take one picture with each camera, the robot standing still; nothing where the scene needs no pictures."""
        if self.sight is not None:
            self.wanted = cameras
            yield self.motion.still()
            self.wanted = ()
            self.sight.see({c: self.images[c] for c in cameras}, self.motion.felt)
            self.effort.failed.clear()  # there may be room where there seemed to be none

    def nearest(self, phrase: str) -> str:
        """The thing that a phrase names, what is still to be picked up first, then the nearest.

        Raises:
            MotionFailure: "unknown_object" if nothing is called so.
        """
        found = self.scene.knowledge().find(phrase)
        if not found:
            raise MotionFailure("unknown_object")
        here = self.motion.felt.base_pose[:2]
        best = (found[0].held, found[0].inside is not None)
        alike = [e for e in found if (e.held, e.inside is not None) == best]
        return min(alike, key=lambda e: float(np.linalg.norm(e.center[:2] - here))).name

    def free_hands(self, name: str, wanted: str | None = None) -> list[Side]:
        """Empty hands, the one on the side of a thing first; only the one `wanted` if given.

        Raises:
            MotionFailure: "hands_full" if there is none.
        """
        free = [s for s in SIDES if self.scene.holding(s) is None and wanted in (None, s)]
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
        out: dict[Side, Held] = {}
        for side in SIDES:
            name = self.scene.holding(side)
            if name is not None:
                T_world_tcp = self.base @ kin.tcp(self.motion.felt.torso, self.motion.felt.arm[side], side)
                frame = kin.inverse(T_world_tcp)
                solids = tuple(s.moved(frame) for n in (name, *self.scene.within(name)) for s in self.scene.solids(n))
                volumes = [v.moved(frame) for v in self.scene.volumes(name)]
                out[side] = Held(name, frame @ self.scene.pose(name), solids, Load(solids, volumes))
        return out

    def search(self, side: Side, touched: Collection[str]) -> Search:
        """A stance search for one hand that works on the things `touched`."""
        held = self.held()
        carried = self._carried(held)
        at = self.motion.felt.base_pose[:2]
        near = self.scene.obstacles(at, _NEAR_M, without={*carried, *touched})
        own: list[Solid] = [s for n in touched if n not in carried for s in self.scene.solids(n)]
        return Search(self.motion, side, held, near, own, self.rng, effort=self.effort)

    def _carried(self, held: Mapping[Side, Held]) -> set[str]:
        """What the robot carries, in one hand or between both, with what lies in it."""
        both = self.scene.between()
        names = [*(h.name for h in held.values()), *([both] if both is not None else [])]
        return {n for name in names for n in (name, *self.scene.within(name))}

    def body(self, without: Collection[str] = ()) -> Body:
        """The robot as commanded, with what it holds, among everything near but the things `without`."""
        held = self.held()
        carried = self._carried(held)
        near = self.scene.obstacles(self.motion.felt.base_pose[:2], _NEAR_M, without={*carried, *without})
        around = near.seen_from(self.base)
        arms = {s: self.motion.arm(s) for s in SIDES}
        return Body(self.motion.torso, arms, {s: h.load for s, h in held.items()}, around)

    def approach(
        self, side: Side, name: str, options: Callable[[], Sequence[Option]], tried: list[Array]
    ) -> Generator[Array, None, tuple[Stance, Search]]:
        """Find a stance to work on a thing from, and its search; the base need not have moved there yet.

        Where the scene is only seen, it looks before it searches, drives, looks from near, and searches again from
        there, so that what it returns rests on what was seen from where it stands.

        Args:
            side: The hand.
            name: The thing.
            options: Says what there is to do, as the thing is known at that time.
            tried: Base poses that did not do; those taken are added.

        Raises:
            MotionFailure: "no_stance", or a drive's own reason.
        """

        def find(search: Search, here_first: bool) -> Stance | None:
            return search.find(self.scene.pose(name)[:2, 3], options(), here_first)

        return (yield from self.close_in(side, {name}, name, find, tried))

    def close_in(
        self, side: Side, touched: Collection[str], about: str | None,
        find: Callable[[Search, bool], Stance | None], tried: list[Array],
    ) -> Generator[Array, None, tuple[Stance, Search]]:  # fmt: skip
        """As `approach`, with `find` to search for a stance, the present one first if it is told so.

        Args:
            side: The hand.
            touched: Things that it works on.
            about: The thing to look at; None to look at the floor ahead.
            find: Finds a stance, or None.
            tried: Base poses that did not do; those taken are added.

        Raises:
            MotionFailure: As `approach`.
        """
        for looks in range(_LOOKS):
            yield from self.study(about)
            search = replace(self.search(side, touched), tried=list(tried))
            stance = find(search, looks > 0)
            if stance is None and self.sight is not None:
                with self.sight.trusting():
                    self.effort.failed.clear()
                    search = replace(search, obstacles=self.search(side, touched).obstacles)
                    stance = find(search, looks > 0)
            if stance is None:
                raise MotionFailure("no_stance")
            tried.append(stance.base)
            away = stance.route[-1] - self.motion.felt.base_pose
            if self.sight is None or (np.linalg.norm(away[:2]) < 0.02 and abs(kin.wrap(away[2])) < 0.03):
                break
            if looks < _LOOKS - 1:
                for base in stance.route:
                    yield from self.motion.drive(base)
        assert stance is not None
        return stance, search

    def study(self, name: str | None) -> Actions:
        """Look at a thing, and above it, or below what is high up; nothing where the scene needs no pictures.

        Without a name it looks at the floor ahead.
        """
        if self.sight is None:
            return
        torso = self.motion.torso
        if name is None:
            torso[3] = _FLOOR_RAD
            yield from self.motion.stand(torso)
            yield from self.see("head")
        else:
            yield from self.motion.stand(self._raised(name) if self.held() else self._overlooking(name))
            yield from self.look_at(name)
            if not self.held() and self._covered(name):
                torso = self.motion.torso
                torso[:3] = [np.clip(self._middle(name)[2] - _EYES_M, *r1.TORSO_LIMITS[0]), 0.0, 0.0]
                yield from self.motion.stand(torso)
                yield from self.look_at(name)
                return
        torso = self.motion.torso
        torso[3] += _HEAD_DOWN_RAD if torso[3] < _LEVEL_RAD else -_HEAD_UP_RAD
        yield from self.motion.stand(torso)
        yield from self.see("head")

    def _raised(self, name: str) -> Array:
        """A torso posture (4,) from which what is high up is seen from the front, with hands that hold something."""
        body, now = self.body({name}), self.motion.torso
        wanted = float(np.clip(self._middle(name)[2] - _EYES_M, now[0], r1.TORSO_LIMITS[0, 1]))
        raised = now
        for lift in np.linspace(now[0], wanted, 5)[1:] if wanted > now[0] else ():
            torso = np.append(lift, now[1:])
            if not replace(body, torso=torso).all_free():
                break
            raised = torso
        return raised

    def _middle(self, name: str) -> Array:
        boxes = np.stack([s.aabb() for s in self.scene.solids(name)])
        return np.asarray((boxes[:, 0].min(0) + boxes[:, 1].max(0)) / 2)

    def _covered(self, name: str) -> bool:
        """Whether something is above a thing, or hides what is there: that is looked into from lower down."""
        middle = self._middle(name)
        around = self.scene.obstacles(middle[:2], _NEAR_M, without=self._carried(self.held()) | {name})
        return bool((around.distance(middle + _ABOVE) < 0.03).any())

    def _overlooking(self, name: str) -> Array:
        """A torso posture (4,) in which the folded hands do not hide a thing from the head: bent over what is near."""
        middle = self._middle(name)
        body, T = self.body({name}), kin.inverse(self.base)
        for lift, pitch in _OVERLOOKS:
            torso = np.array([max(lift, min(0.55, float(middle[2]) - 0.65)), 0.0, pitch, self.motion.torso[3]])
            ahead = (kin.inverse(kin.chest(torso)) @ T @ np.append(middle, 1.0))[:3] - r1.HEAD_M - r1.HEAD_CAMERA_M
            if np.arctan2(-ahead[2], max(float(ahead[0]), 0.0)) < _HANDS_RAD and replace(body, torso=torso).all_free():
                return torso
        return self.motion.torso

    def refined(self, side: Side, stance: Stance, options: Sequence[Option]) -> Stance:
        """A stance whose arm is at its first waypoint, with the waypoints of the option that is now nearest to it.

        What a look from there has corrected is corrected; the stance itself if no line leads to any such option.
        """
        planned = self.base @ kin.tcp(self.motion.torso, self.motion.arm(side), side)
        to_base = kin.inverse(self.base)
        lift = stance.waypoints[-1][2, 3] - stance.waypoints[-2][2, 3]
        alike = [o for o in options if abs(o.waypoints[-1][2, 3] - o.waypoints[-2][2, 3] - lift) < 0.005]
        for option in sorted(alike, key=lambda o: _apart(planned, o.waypoints[0]))[:_REFINED]:
            if _apart(planned, option.waypoints[0]) > _CORRECTED:
                break
            waypoints, q = to_base @ option.waypoints, self.motion.arm(side)
            for T in waypoints:
                line = arm_motion.trace(self.motion.torso, side, q, T)
                if line is None:
                    break
                q = line[-1]
            else:
                return replace(stance, base=self.motion.felt.base_pose.copy(), waypoints=waypoints)
        return stance

    def take_up(self, stance: Stance, search: Search) -> Actions:
        """Go to a stance: drive, the other hand aside, the torso, the arm to the first waypoint, then straight in."""
        for base in stance.route:
            yield from self.motion.drive(base)
        if search.other is not None and len(stance.aside) > 1:
            yield from self.motion.follow(search.other, stance.aside, speed=0.8)
        yield from self.motion.stand(stance.torso, stance.level)
        yield from self.motion.follow(search.side, stance.path)
        if stance.runs_up:
            yield from self.motion.drive(stance.base, _INWARD_M_S)

    def leave(self, stance: Stance) -> Actions:
        """Out again, the way that the base drove straight in."""
        if stance.runs_up:
            yield from self.motion.drive(stance.route[-1], _INWARD_M_S)

    def withdraw(self, side: Side, stance: Stance) -> Actions:
        """After a failure at a stance: back to its first waypoint, then out; a hand that holds nothing is opened."""
        if not self.gripped(side):
            yield from self.motion.grip(side, 1.0, 0.4)
        with suppress(MotionFailure):
            yield from self.lines(side, stance, [0])
        with suppress(MotionFailure):
            yield from self.leave(stance)

    def back_off(self) -> Actions:
        """A little back, straight, as it stands; where that is not free, less; nothing where it cannot move at all."""
        here, body = self.motion.felt.base_pose, self.body()
        ahead = np.array([np.cos(here[2]), np.sin(here[2]), 0.0])
        near = self.scene.obstacles(here[:2], _NEAR_M, without=self._carried(self.held()))
        for by in (0.35, 0.2):
            lane = [kin.base(here - ahead * by * u) for u in (0.4, 0.7, 1.0)]
            around = [near.seen_from(T) for T in lane]
            if all(base_clear(a) and replace(body, around=a).all_free() for a in around):
                yield from self.motion.drive(here - ahead * by)
                return

    def covered(self, side: Side) -> bool:
        """Whether there is something above a hand: a board, the top of a compartment."""
        at = (self.base @ self.motion.hand(side))[:3, 3] + np.array([[0.0, 0.0, z] for z in np.arange(0.1, 1.2, 0.04)])
        near = self.scene.obstacles(self.motion.felt.base_pose[:2], _NEAR_M, without=self._carried(self.held()))
        return bool((near.distance(at) < 0.03).any())

    def lines(self, side: Side, stance: Stance, waypoints: Sequence[int], speed: float = 0.16) -> Actions:
        """Straight lines through some of a stance's waypoints, corrected for where the base really stands."""
        shift = kin.inverse(self.base) @ kin.base(stance.base)
        for k in waypoints:
            yield from self.motion.line(side, shift @ stance.waypoints[k], speed)

    def rise(self, side: Side, by_m: float = _LIFTED_M) -> Actions:
        """Raise a hand straight up."""
        T = self.motion.hand(side)
        T[2, 3] += by_m
        yield from self.motion.line(side, T)

    def settle(self, without: Collection[str] = ()) -> Actions:
        """Fold the empty arms and bring what is held to the chest, upright, the torso as for traveling.

        Args:
            without: Things that the hands may be in touch with at first.

        Raises:
            MotionFailure: "no_fold" or "no_carry" if no such posture can be reached.
        """
        try:
            yield from self._settle(without)
        except MotionFailure as failure:
            if failure.reason not in ("no_fold", "no_carry"):
                raise
            yield from self.back_off()
            yield from self._settle(without)

    def unwedge(self) -> Actions:
        """Where what is held hangs so near the body that the torso could not move, bring it to the chest."""
        body = self.body()
        hands = {s: arm_motion.stay(self.motion.hand(s)) for s in body.held}
        if arm_motion.sweep(body, self.motion.torso, hands, samples=1) is None:
            with suppress(MotionFailure):
                yield from self.settle()

    def _settle(self, without: Collection[str]) -> Actions:
        held = self.held()
        for side in (s for s in SIDES if s not in held):
            if np.abs(self.motion.arm(side) - r1.TRAVEL_ARM[side]).max() > 0.02:
                yield from self.motion.follow(side, self._fold(side, without))
        upright = np.append(r1.TRAVEL_TORSO[:3], self.motion.torso[3])
        arms = self._homeward(upright, without)
        if arms is None:
            raise MotionFailure("no_carry")
        yield from self.motion.stand(upright, arms)

    def _fold(self, side: Side, without: Collection[str]) -> list[Array]:
        """A path home for an empty arm, well clear of the things `without` too if it can be: they stand loose."""
        now, home = self.motion.arm(side), r1.TRAVEL_ARM[side]
        for spared, margin in (((), _FOLD_CLEAR_M), ((), 0.0), (without, 0.0)):
            path = arm_motion.plan(self.body(spared), side, home, self.rng, margin, start=now)
            if path is not None:
                return path
        raise MotionFailure("no_fold")

    def _homeward(self, torso: Array, without: Collection[str]) -> dict[Side, list[Array]] | None:
        """Postures of the arms that hold something, while the torso goes to its travel posture.

        What can stay where it is stays; of two things held the one in the lower hand, just picked up, moves first.
        """
        body = self.body(without)
        hands = {s: arm_motion.stay(self.motion.hand(s)) for s in body.held}
        if (found := arm_motion.sweep(body, torso, hands)) is not None:
            return found
        for side in sorted(body.held, key=lambda s: float(self.motion.hand(s)[2, 3])):
            now, checked = self.motion.hand(side), 0
            for T in self._carries(side, body):
                q = kin.nearest_posture(kin.inverse(kin.chest(torso)) @ T, side, self.motion.arm(side))
                if q is None or not replace(body, torso=torso[:3]).free(side, q)[0]:
                    continue
                for detour in _DETOURS:
                    path = arm_motion.glide(now, T, detour * [1, r1.SIGN[side], 1])
                    if (found := arm_motion.sweep(body, torso, {**hands, side: path})) is not None:
                        return found
                checked += 1
                if checked >= _CHECKED_CARRIES:
                    break
        return None

    def look_at(self, name: str) -> Actions:
        """Tilt the head so that a thing is in the middle of its view, up or down, and look."""
        torso = self.motion.torso
        boxes = np.stack([s.aabb() for s in self.scene.solids(name)])
        middle = (boxes[:, 0].min(0) + boxes[:, 1].max(0)) / 2
        seen = kin.inverse(self.base @ kin.chest(torso)) @ np.append(middle, 1.0)
        ahead = seen[:3] - r1.HEAD_M
        torso[3] = np.clip(np.arctan2(-ahead[2], max(float(ahead[0]), 0.05)), *r1.TORSO_LIMITS[3])
        yield from self.motion.stand(torso)
        yield from self.see("head")

    def tuck(self) -> Actions:
        """Bring what is held closer to the body, for driving."""
        body = self.body()
        for side in body.held:
            arms = {s: self.motion.arm(s) for s in SIDES}
            now, checked = self.motion.hand(side), 0
            body = replace(body, arms=arms)
            for T in self._carries(side, body):
                if np.linalg.norm(T[:3, 3] - now[:3, 3]) < 0.03 or checked >= _CHECKED_CARRIES:
                    break  # as good as home
                q = kin.nearest_posture(kin.inverse(kin.chest(self.motion.torso)) @ T, side, arms[side])
                if q is None or not body.free(side, q)[0]:
                    continue
                path = arm_motion.plan_level(body, side, T)
                if path is not None:
                    yield from self.motion.follow(side, path, speed=1.0)
                    break
                checked += 1

    def _carries(self, side: Side, body: Body) -> list[Array]:
        """T_base_tcp (4, 4) to carry what `side` holds, tilted as now, the most compact first."""
        now, load = self.motion.hand(side), body.held[side]
        ranked = []
        for x, y, z, yaw in _CARRIES:
            T = kin.transform(kin.rot_z(yaw * r1.SIGN[side]) @ now[:3, :3], (x, y * r1.SIGN[side], z))
            reach = np.hypot(*(load.centers @ T[:2, :3].T + T[:2, 3]).T) + load.radii
            ranked.append((float(reach.max()) + 0.05 * abs(yaw) + 0.2 * abs(z - _CARRY_HEIGHT_M), T))
        return [T for _, T in sorted(ranked, key=lambda r: r[0])]

    def gripped(self, side: Side) -> bool:
        """Whether the closed hand has something between its fingers, by its width."""
        return self.motion.felt.holds(side)


def _apart(T: Array, other: Array) -> float:
    """How far two hand poses (4, 4) are apart: their angle [rad], and 5 cm count as a tenth of one."""
    turn = float(np.arccos(np.clip((np.trace(T[:3, :3].T @ other[:3, :3]) - 1) / 2, -1, 1)))
    return turn + 2 * float(np.linalg.norm(T[:3, 3] - other[:3, 3]))


_CARRY_HEIGHT_M = 0.80
_CHECKED_CARRIES = 25
# Off the middle of a hand's way home, y toward its own side [m].
_DETOURS = np.array([(0.0, 0, 0), (0, 0.12, 0), (0, 0, 0.2), (0, 0.25, 0), (0.15, 0.15, 0), (0, 0.25, -0.2)])
# Where to carry things: x, y toward the own side, z [m] and a turn about the vertical [rad].
_CARRIES = [
    (x, y, z, yaw)
    for x in (0.28, 0.33, 0.38, 0.43, 0.49)
    for y in (0.02, 0.08, 0.14, 0.20, 0.28)
    for z in (0.72, 0.80, 0.88, 0.98)
    for yaw in (0.0, 0.4, -0.4, 0.8, -0.8, 1.2, -1.2, 1.57, -1.57, 2.2, -2.2, 3.1)
]


# What performs a skill: work, the words of the call, and base poses tried before, to which each try adds its own.
Perform = Callable[[Work, Words, list[Array]], Actions]
