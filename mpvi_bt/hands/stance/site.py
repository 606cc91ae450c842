"""Where a hand is to work: what is around, and how the body stands at a base pose."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.finding.scene.hands import Held
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array, Solid, box
from mpvi_bt.ground.robot import arm_motion
from mpvi_bt.ground.robot.arm_motion import HandPath
from mpvi_bt.ground.robot.collision import NOTHING, Body, Obstacles, Surroundings, Together
from mpvi_bt.ground.robot.model import SIGN, RobotModel
from mpvi_bt.ground.robot.motion import Motion
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.stance.effort import Effort
from mpvi_bt.hands.stance.refusals import Refusals

FLOOR = box((0.0, 0.0, -0.1), (60.0, 60.0, 0.2))  # our choice: its top is the floor, and no house is as wide
_VIEWS = 16  # our choice: views of the surroundings that are kept


@dataclass(frozen=True)
class PayloadAside:
    """How an idle hand moves its payload aside."""

    # pitches of the torsos from which the payload should be in reach there [rad]; our choice
    pitches_rad: tuple[float, ...] = (0.0, 0.25, 0.5, 0.8, 1.1)
    # turns of the payload about the vertical [rad]; bent torsos need one for a wrist of little range; our choice
    turns_rad: tuple[float, ...] = (0.0, 0.8, -0.8, 1.6, -1.6, 2.4, -2.4, np.pi)
    share: float = 0.2  # least part of the torsos that reach the payload, or another turn is tried [ratio]; our choice
    swivels: int = 12  # positions of the elbow; our choice


_ASIDE = PayloadAside()


@dataclass(frozen=True)
class PayloadMeanwhile:
    """Where the working hand holds its payload while the torso moves: out, or on to the work place.

    Our choice: a lowered or bent torso would meet a payload that hangs close to it, such as a sack from its handle.
    """

    # offsets out from where the payload is: x, y toward the hand's own side, z [m]
    out_m: tuple[tuple[float, float, float], ...] = ((0.12, 0.1, -0.12), (0.2, 0.1, -0.15), (0.3, 0.1, -0.2))
    # turns about the vertical out there, for a broad payload on the near side of its hand [rad]
    out_rad: tuple[float, ...] = (0.0, 0.8, -0.8)
    # offsets of the middle of the way on, if something over the place leaves no room out there [m]
    on_m: tuple[tuple[float, float, float], ...] = (
        (0.0, 0.0, 0.0),
        (0.0, 0.0, 0.15),
        (-0.15, 0.0, 0.0),
        (0.15, 0.0, 0.15),
    )
    samples: int = 6  # samples of a payload's way while it keeps its place or rides along
    more: int = 12  # samples while it is moved out or on


_MEANWHILE = PayloadMeanwhile()


@dataclass(frozen=True)
class Comfort:
    """Costs that make one posture worse than another."""

    limit: float = 3.0  # cost of joints near their limits; our choice
    pitch: float = 0.6  # cost of each radian of the trunk's pitch; our choice
    lift: float = 0.5  # cost of each meter that the trunk is raised or lowered; our choice
    arm: float = 0.1  # cost of each radian that a joint of the arm moves; our choice


_COMFORT = Comfort()


@dataclass(frozen=True, eq=False)
class Standing:
    """The body once the torso has moved, and how the other hand was kept level meanwhile."""

    body: Body
    level: Mapping[Side, list[Array]]


@dataclass(frozen=True, eq=False)
class Site:
    """What a search for a place to stand is about.

    Attributes:
        motion: The robot's present command and feeling.
        side: The hand that works.
        held: What each hand holds.
        obstacles: What is in the way, in the world, without what is held.
        touched: Those solids in the world that the hand works on: obstacles to the base and until contact.
        rng: Randomness of arm planning.
        tried: Base poses (3,) that did not do.
        effort: What it may take.
        underfoot: What is in the way of the base besides, in the world.
        refusals: What candidates are refused for.
        trusting: Whether what no picture has shown counts as free.
    """

    motion: Motion
    side: Side
    held: Mapping[Side, Held]
    obstacles: Obstacles
    touched: Sequence[Solid]
    rng: np.random.Generator
    tried: list[Array] = field(default_factory=list)
    effort: Effort = field(default_factory=Effort)
    underfoot: Obstacles = field(default=NOTHING, kw_only=True)
    refusals: Refusals = field(default_factory=Refusals, kw_only=True)
    trusting: bool = field(default=False, kw_only=True)

    @property
    def other(self) -> Side | None:
        """The other hand, if it holds something: that has to stay level."""
        return next((s for s in self.held if s != self.side), None)

    @cached_property
    def holds(self) -> list[list[Array]]:
        """Ways to bring the other hand aside, each a path of postures; the first is to leave it where it is."""
        side = self.other
        if side is None:
            return [[]]
        body, holds = self.body(self.motion.torso, NOTHING), [[self.motion.arm(side)]]
        for at in self.motion.robot.aside * [1, SIGN[side], 1]:
            T = self._turned(self.motion.hand(side), side, at)
            if (path := arm_motion.plan_level(body, side, T)) is not None:
                holds.append(path)
        return holds

    def _turned(self, T: Array, side: Side, at: Array) -> Array:
        """T_base_tcp (4, 4) at a place (3,), as upright as before; turned if few torsos would have it in reach so."""
        robot = self.motion.robot
        turned = np.stack([kin.transform(matmul(kin.rot_z(turn), T[:3, :3]), at) for turn in _ASIDE.turns_rad])
        chests = kin.inverse(robot.chest(self.torsos(_ASIDE.pitches_rad)[0]))
        reached, _ = robot.arm_inverse(
            matmul(chests[:, None], turned[None]).reshape(-1, 4, 4), side, swivels=_ASIDE.swivels
        )
        shares = np.bincount(np.unique(reached) % len(turned), minlength=len(turned)) / len(chests)
        return np.asarray(turned[0 if shares[0] >= _ASIDE.share else int(shares.argmax())])

    def torsos(self, pitches: Sequence[float]) -> tuple[Array, Array]:
        """Joints (m, 4) and postures (m, 4) of the torsos that a search tries, at pitches [rad]."""
        robot = self.motion.robot
        postures = robot.postures(pitches, float(robot.trunk.posture(robot.travel_torso)[3]))
        return robot.trunk.joints(postures), postures

    def torsos_amid(self, pitches: Sequence[float], around: Obstacles) -> tuple[Array, Array]:
        """As `torsos`, without those that meet something around, in the base frame.

        Where the trunk meets something at one pitch and not at the next, the pitch between them is among them.
        """
        torsos, postures, centers, radii = self._trunks(tuple(pitches))
        free = (around.distance(centers) > radii).all(1).reshape(len(self.motion.robot.lifts), -1)
        wanted = np.isin(postures[:, 2], pitches).reshape(free.shape)
        wanted[:, 1:-1] |= free[:, :-2] != free[:, 2:]
        rows = (free & wanted).ravel()
        return torsos[rows], postures[rows]

    def _trunks(self, pitches: tuple[float, ...]) -> tuple[Array, Array, Array, Array]:
        """`torsos` at pitches and halfway between them; centers (m, n, 3) in the base frame and radii (n,) of each."""
        if pitches not in self._trunks_at:
            halfway = [(a + b) / 2 for a, b in itertools.pairwise(pitches)]
            torsos, postures = self.torsos(sorted([*pitches, *halfway]))
            centers, radii = zip(*(self.body(torso, NOTHING).trunk for torso in torsos), strict=True)
            self._trunks_at[pitches] = torsos, postures, np.stack(centers), radii[0]
        return self._trunks_at[pitches]

    @cached_property
    def _trunks_at(self) -> dict[tuple[float, ...], tuple[Array, Array, Array, Array]]:
        return {}  # the same at every base pose

    def postures(
        self, goals: Array, costs: Sequence[float], trunks: tuple[Array, Array], swivels: int
    ) -> tuple[Array, NDArray[np.intp], NDArray[np.intp], Array]:
        """Postures of torso and arm in which the hand that works reaches a goal, the most comfortable first.

        Args:
            goals: (k, 4, 4) T_base_tcp.
            costs: Preference, of each goal.
            trunks: Joints (m, 4) and postures (m, 4) of the torsos in question.
            swivels: How many places of the elbow.

        Returns:
            Torsos (m, 4); the index of its torso (n,), the index of its goal (n,) and the arm (n, 7) of each posture.
        """
        robot = self.motion.robot
        torsos, postures = trunks
        lift = robot.trunk.posture(self.motion.torso)[0]
        chests = kin.inverse(robot.chest(torsos))
        at, q = robot.arm_inverse(matmul(chests[:, None], goals[None]).reshape(-1, 4, 4), self.side, swivels=swivels)
        t, g = at // len(goals), at % len(goals)
        cost = (
            _COMFORT.limit * robot.limit_cost(q, self.side)
            + _COMFORT.pitch * postures[t, 2] + _COMFORT.lift * np.abs(postures[t, 0] - lift)
            + np.array(costs)[g] + _COMFORT.arm * np.abs(q - self.motion.arm(self.side)).sum(1)
        )  # fmt: skip
        rows = np.argsort(cost)
        return torsos, t[rows], g[rows], q[rows]

    def around(self, base: Array, touched: bool) -> Obstacles:
        """What is in the way and the floor in the frame of a base pose, with or without what the hand works on."""
        key = base.tobytes(), touched
        if key not in self._near:
            if len(self._near) >= _VIEWS:
                self._near.clear()
            self._near[key] = (self.everything if touched else self.rest).seen_from(kin.base(base))
        return self._near[key]

    @cached_property
    def _near(self) -> dict[tuple[bytes, bool], Obstacles]:
        return {}  # of the last base poses: at each one it is asked hundreds of times

    @cached_property
    def everything(self) -> Obstacles:
        """All that is in the way, what the hand works on and the floor too, in the world."""
        return Together([self.obstacles, Surroundings([FLOOR, *self.touched])])

    @cached_property
    def rest(self) -> Obstacles:
        """The same without what the hand works on."""
        return Together([self.obstacles, Surroundings([FLOOR])])

    def body(self, torso: Array, around: Obstacles, arms: Mapping[Side, Array] | None = None) -> Body:
        """The robot in a posture, with what it holds."""
        arms = arms or {s: self.motion.arm(s) for s in self.motion.robot.sides}
        key = torso.tobytes(), *(q.tobytes() for q in arms.values())
        if key not in self._bodies:
            held = {s: h.load for s, h in self.held.items()}
            self._bodies[key] = Body(self.motion.robot, torso, dict(arms), held)
        return self._bodies[key].amid(around)

    @cached_property
    def _bodies(self) -> dict[tuple[bytes, ...], Body]:
        return {}  # by posture, among nothing: a search takes the same ones at every base pose

    def stood(
        self, torso: Array, around: Obstacles, arms: Mapping[Side, Array], first: Array | None = None
    ) -> Standing | None:
        """The body once the torso has moved there, the other hand level if it holds something; None if it cannot.

        Args:
            torso: (4,) where to.
            around: What is in the way, in the base frame.
            arms: Postures (7,) of the arms before.
            first: T_base_tcp (4, 4) where the hand that works goes next, to be tried where all other ways fail: it goes
                there meanwhile, if what it holds is not filled, as that may be on a slant. None: the other ways.
        """
        body = self.body(self.motion.torso, around, arms)
        if arm_motion.trunk_touching(body, torso, _MEANWHILE.more) is not None:  # whatever the hands do
            return None
        posture = torso.tobytes(), *(q.tobytes() for q in arms.values()), b"" if first is None else first.tobytes()
        for k, (samples, hands) in enumerate(self._meanwhile(body, arms, first)):
            key: tuple[int | bytes, ...] = (k, *posture)
            if key not in self._swung:
                self._swung[key] = arm_motion.swing(body, torso, hands(), samples)
            level = self._swung[key]
            if level is not None and arm_motion.touching(body, torso, level, samples) is None:
                after = {**arms, **{s: q[-1] for s, q in level.items()}}
                return Standing(replace(body, torso=torso, arms=after), level)
        return None

    def _meanwhile(
        self, body: Body, arms: Mapping[Side, Array], first: Array | None
    ) -> Iterator[tuple[int, Callable[[], dict[Side, HandPath]]]]:
        """Ways of the hands while the torso moves: how many samples, and what makes the paths; see `stood`.

        Payloads keep their place, or ride along with the torso, or are brought out; or on to `first`.
        """
        now = {s: body.robot.tcp(body.torso, arms[s], s) for s in self.held}
        stays = {s: arm_motion.stay(T) for s, T in now.items()}
        if first is None:
            yield _MEANWHILE.samples, lambda: stays
        if self.side not in self.held or (first is not None and self.held[self.side].laden):
            return
        here = now[self.side]

        def paths(T: Array, detour: Array | None = None) -> dict[Side, HandPath]:
            return {**stays, self.side: arm_motion.glide(here, T, detour)}

        def out(turn: float, off: Array) -> dict[Side, HandPath]:
            R = matmul(kin.rot_z(turn), here[:3, :3])
            return paths(kin.transform(R, here[:3, 3] + off * [1, SIGN[self.side], 1]))

        if first is not None:
            for detour in np.array(_MEANWHILE.on_m):
                yield _MEANWHILE.more, partial(paths, first, detour)
            return
        yield _MEANWHILE.samples, lambda: {s: path for s, path in stays.items() if s != self.side}
        for turn, off in itertools.product(_MEANWHILE.out_rad, np.array(_MEANWHILE.out_m)):
            yield _MEANWHILE.more, partial(out, turn, off)

    @cached_property
    def _swung(self) -> dict[tuple[int | bytes, ...], dict[Side, list[Array]] | None]:
        return {}  # by way and postures, once they are asked for: the body does the same at every base pose


def base_clear(robot: RobotModel, around: Obstacles) -> bool:
    """Whether the base and the column above it keep clear of what is `around`, in the base frame."""
    standing = robot.hull.standing
    return bool((around.distance(standing[:, :3]) >= standing[:, 3]).all())
