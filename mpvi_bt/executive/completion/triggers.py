"""Proprioceptive triggers: events at the end of a grasp, a release or another motion."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mpvi_bt.ground.errors import UnknownName
from mpvi_bt.ground.geometry import kinematics
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import TriggerEvent
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Proprioception, Robot, Side
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.ground.robot.squeeze import squeezes

_GENERAL = ("grasp", "release", "stop", "rest", "idle")  # ends of a primitive that nobody has told us of
KINDS = (*_GENERAL, "arrival")
_STEPS_OF_A_RATE = 3  # rates of change are taken over so many steps
_LONG_AGO = 10**9  # steps


@dataclass(frozen=True)
class Thresholds:
    """Thresholds of a grasp, a release, a stop and a rest.

    Our choice; the paper says only that a gripper "closes and holds at a nonzero width".
    """

    smoothing: float = 0.4  # weight of the newest width in its exponential moving average
    still_m_s: float = 0.002  # the width is steady while it changes by less [m/s]
    hold_s: float = 0.33  # how long the width must be steady [s]
    held_m: float = 0.003  # a hand this much wider than its command has something between its fingers [m]
    empty_m: float = 0.0015  # a hand this close to its command has nothing; in between, the last state is kept [m]
    opened_m: float = 0.015  # how much wider than its grasp a hand must get to have let go [m]
    full_m: float = 0.095  # or how wide at all, with a thing nearly as wide as the hand opens [m]
    fall_s: float = 0.25  # time for what was let go to fall by 0.3 m [s]
    arm_still_rad_s: float = 0.05  # the arms are at rest while every joint is slower; for "rest", base [m/s] and torso
    moved_rad: float = 0.3  # how far a joint of an arm must turn after a rest for the next one to be an event [rad]
    moved_m: float = 0.10  # how far a hand moves its payload, from the grasp or last event, before a stop counts [m]
    still_hand_m_s: float = 0.01  # and how slow it must be then [m/s]
    driven_m: float = 0.1  # how far the base must drive for its rest to be an event [m]
    turned_rad: float = 0.2  # or how far it must turn [rad]
    arrived_s: float = 1.0  # and how long the whole body must then stand [s]; a look around pauses for less
    idle_s: float = 3.0  # a robot that stands still for so long has no more to do [s]
    settle_s: float = 0.5  # how long the arms must be at rest [s]; the event marks the end of a primitive
    refractory_s: float = 1.0  # least time between two events of one hand, unless a skill says otherwise [s]


class ProprioceptiveTriggers:
    """Watches both hands and the whole body, and fires when a primitive may just have ended (implements `Triggers`).

    "grasp", "release": a hand has closed and holds a width, or has let go, and the arms have come to rest. It fires
    once, and anew after the arms have moved and settled again, so that a judge who said no is asked again when there
    may be something new to see (Paper, Completion Checker appendix).

    Two hands that pressed a thing between them and do so no more have let go of it, too: a "release" of no hand, when
    the whole body has come to rest. Our choice: the paper's triggers know grippers only, and those stay open meanwhile.

    "stop": a grasped object was moved and has stopped, the hand still on it, such as a door at its end stop. An object
    that was in hand before, such as a bin that is carried along, causes none.

    "rest": the arms have moved and the whole body has come to rest. It covers primitives without the events above, such
    as pushing a door shut or pressing a button. It belongs to the arm that moved farther. If a hand has grasped
    something since, such as a door's bar, it fires after the release.

    "arrival": the base has driven or turned and the whole body is at rest. Our choice, for policies that drive (the
    paper's heuristics concern grippers and arms): only a skill that drives uses it. The first rest is an arrival, too,
    as the robot may be there already (Paper, Navigation appendix: that is checked first).

    "idle": the whole body has stood still for seconds without another event: the policy has no more to do. It covers
    primitives that were done at the start, such as the pick of an object in hand, and results that only the present
    pose shows. It fires for each hand with a payload in turn, or for none. Our choice: it fires once until the body
    moves again, since the same picture would be judged the same. Where a release ends the primitive it does not fire
    before one: a policy that is planning stands still as well, and another can may be in the bin already.

    Of several simultaneous events the first of this list fires.

    Attributes:
        released: The hand that has let go `fall_s` before this step; None in all other steps. What it held has fallen,
            and it is where it let go, or near. The event follows when the arms have come to rest.
    """

    def __init__(self, robot: Robot, thresholds: Thresholds | None = None) -> None:
        """Watch `robot`, as after `reset()`."""
        self._robot = robot
        self.thresholds = thresholds or Thresholds()
        self.reset()

    def reset(self, kinds: Mapping[str, float | None] | None = None) -> None:
        """Begin anew. Payloads at this time cause no event.

        Args:
            kinds: As of `Triggers`; None: all but "arrival", as a primitive that nobody has told us of may end in any
                (Paper, Proprioceptive trigger: general heuristics).

        Raises:
            UnknownName: A kind that these triggers do not have.
        """
        for kind in kinds or ():
            if kind not in KINDS:
                raise UnknownName("trigger", kind, KINDS)
        given = dict.fromkeys(_GENERAL) if kinds is None else kinds
        refractory_s = self.thresholds.refractory_s
        self._apart = {kind: _steps(refractory_s if s is None else s) for kind, s in given.items()}
        body = self._robot.proprioception()
        self._hands = {side: _Hand(self.thresholds, body, side) for side in body.sides}
        self._angles: deque[Array] = deque(maxlen=_STEPS_OF_A_RATE + 1)
        self._rest = _ArmRest(self.thresholds, body)
        self._press = _Press(self.thresholds, body) if "release" in self._apart else None
        self._drive = _BaseArrival(self.thresholds)
        self._idle: list[Side | None] = []  # whose it is still to be told of
        self.released: Side | None = None

    def update(self) -> TriggerEvent | None:
        """Read proprioception once a step; the event that fires now, if any.

        With both hands due in one step the left comes first and the right in the next.
        """
        body = self._robot.proprioception()
        moving = self._arms_move(body)
        self.released = None
        for side, hand in self._hands.items():
            hand.feel(body, moving)
            if hand.opened == _steps(self.thresholds.fall_s):
                self.released = side
            if "stop" in self._apart:
                hand.feel_way(body)
        steady = all(hand.steady for hand in self._hands.values())
        rested = self._rest.feel(body, steady)
        if self._press is not None:
            self._press.feel(body, self._rest.stands)
        for side, hand in self._hands.items():
            if (kind := hand.due(self._apart)) is not None:
                hand.fired()
                self._rest.fired()
                return TriggerEvent(kind, side)
        if self._press is not None and self._press.due and self._rest.since_event >= self._apart["release"]:
            self._press.fired()
            self._rest.fired()
            return TriggerEvent("release", None)
        took = any(hand.took for hand in self._hands.values())
        if rested and not took and "rest" in self._apart and self._rest.since_event >= self._apart["rest"]:
            self._rest.fired()
            return TriggerEvent("rest", rested)
        due = "arrival" in self._apart and self._rest.since_event >= self._apart["arrival"]
        if due and self._drive.arrived(body, self._rest.stands_for(self.thresholds.arrived_s)):
            self._rest.fired()
            return TriggerEvent("arrival", None)
        return self._idles() if "idle" in self._apart and self._may_be_done() else None

    def _may_be_done(self) -> bool:
        """Whether anything was let go, where the primitive ends so."""
        if "release" not in self._apart or "grasp" in self._apart:
            return True
        return any(hand.let_go for hand in self._hands.values()) or bool(self._press and self._press.let_go)

    def _idles(self) -> TriggerEvent | None:
        """The event "idle" if it is due: the body stands still and does no more."""
        rest, seconds = self._rest, self.thresholds.idle_s
        if not rest.stands:
            self._idle = []
        elif rest.stands_for(seconds) and not rest.told:
            self._idle = [side for side, hand in self._hands.items() if hand.holds] or [None]
        if not self._idle or rest.since_event < self._apart["idle"]:
            return None
        rest.fired()
        return TriggerEvent("idle", self._idle.pop(0))

    def _arms_move(self, body: Proprioception) -> bool:
        """Whether a joint of either arm turns; both, as one hand may have let go while the other still brings its load.

        From the angles, not from the measured speeds: an arm that holds a load against friction can report a steady
        speed of 0.1 rad/s while it stands.
        """
        self._angles.append(np.concatenate([body.arm[side] for side in body.sides]))
        turned = np.abs(self._angles[-1] - self._angles[0]).max()
        return bool(turned * CONTROL_HZ > self.thresholds.arm_still_rad_s * max(len(self._angles) - 1, 1))


class _Hand:
    """What one hand has been doing."""

    def __init__(self, thresholds: Thresholds, body: Proprioception, side: Side) -> None:
        self._t, self._side = thresholds, side
        self._width = float(body.gripper_width[side])
        self._steady = 0  # steps with an unchanging width
        self._at_rest = 0  # steps with the arms at rest
        self._since_event = _LONG_AGO
        self._recent: deque[float] = deque([self._width], maxlen=_STEPS_OF_A_RATE + 1)  # smoothed
        # Of a hand that holds something from the start, as after another primitive, only a release can be new.
        grips = self._width > _told_m(body, side) + thresholds.held_m
        self._grasp_width = self._width if grips else None
        self._news: Literal["grasp", "release"] | None = None
        self._armed = False
        self._way: _Way | None = None  # of what it took hold of since
        self.opened = 0  # steps since it let go of what it held

    def feel(self, body: Proprioception, moving: bool) -> None:
        """Take in one step; `moving` says whether an arm moves."""
        t = self._t
        self._width += t.smoothing * (float(body.gripper_width[self._side]) - self._width)
        self._recent.append(self._width)
        rate = abs(self._recent[-1] - self._recent[0]) / max(len(self._recent) - 1, 1) * CONTROL_HZ
        self._steady = self._steady + 1 if rate < t.still_m_s else 0
        self._at_rest = 0 if moving else self._at_rest + 1
        self._since_event += 1
        if moving:
            self._armed = True
        told_m = _told_m(body, self._side)
        grips = self._width > told_m + t.held_m
        if self.opened or (self._grasp_width is not None and self._opens(grips)):
            self.opened = 0 if grips else self.opened + 1
        if not self.steady:
            return
        if self._grasp_width is None:
            if grips:
                self._grasp_width = self._width
                self._way = _Way(self._t)
                self._report("grasp")
        else:
            let_go = self._opens(grips)
            # One that begins to open is told, for a moment, to be as wide as what it holds.
            closer = self._width < self._grasp_width - t.empty_m
            slipped = closer and self._width < told_m + t.empty_m  # maybe where it was to lie
            if let_go or slipped:
                self._grasp_width, self._way = None, None
                self._report("release")

    def _opens(self, grips: bool) -> bool:
        """Whether it is so much wider than its grasp that it has let go."""
        assert self._grasp_width is not None
        return not grips and self._width >= min(self._grasp_width + self._t.opened_m, self._t.full_m)

    def feel_way(self, body: Proprioception) -> None:
        """Take in where the hand is in the world, if it has taken hold of something."""
        if self._way is not None:
            robot = robot_named(body.robot)
            T = matmul(kinematics.base(body.base_pose), robot.tcp(body.torso, body.arm[self._side], self._side))
            self._way.feel(T[:3, 3])

    @property
    def steady(self) -> bool:
        """Whether the fingers stand."""
        return self._steady >= _steps(self._t.hold_s)

    @property
    def holds(self) -> bool:
        """Whether it has something between its fingers."""
        return self._grasp_width is not None

    @property
    def took(self) -> bool:
        """Whether it has taken hold of something that it still holds."""
        return self._way is not None

    @property
    def let_go(self) -> bool:
        """Whether it has let go of something, and taken nothing since."""
        return self._news == "release"

    def _report(self, news: Literal["grasp", "release"]) -> None:
        self._news, self._armed = news, True
        self._at_rest = 0  # a rest from now on ends the primitive; the hand's own pause while it closed does not

    def due(self, apart: Mapping[str, int]) -> str | None:
        """The kind of the event that this hand has to report now, if any; `apart`: steps between events, by kind."""
        if self._at_rest < _steps(self._t.settle_s):
            return None
        news = self._news if self._armed else None
        if news is not None and news in apart and self._since_event >= apart[news]:
            return news
        stopped = self._way is not None and self._way.ended
        return "stop" if stopped and "stop" in apart and self._since_event >= apart["stop"] else None

    def fired(self) -> None:
        """The event was reported; it is due again only after the arm has moved and settled."""
        self._armed, self._since_event = False, 0
        if self._way is not None:
            self._way = _Way(self._t)


class _Way:
    """How far a hand has moved what it holds, and whether it stands now."""

    def __init__(self, thresholds: Thresholds) -> None:
        self._t = thresholds
        self._recent: deque[Array] = deque(maxlen=_STEPS_OF_A_RATE + 1)
        self._home: Array | None = None
        self._farthest_m = 0.0
        self._still = 0  # steps

    def feel(self, p_hand_world: Array) -> None:
        """Take in where it is (3,) [m]."""
        home = self._home = p_hand_world if self._home is None else self._home
        self._recent.append(p_hand_world)
        self._farthest_m = max(self._farthest_m, float(norm(p_hand_world - home)))
        went_m = float(norm(p_hand_world - self._recent[0]))
        slow = went_m * CONTROL_HZ <= self._t.still_hand_m_s * max(len(self._recent) - 1, 1)
        self._still = self._still + 1 if slow else 0

    @property
    def ended(self) -> bool:
        """Whether it went far enough and stands."""
        return self._farthest_m > self._t.moved_m and self._still >= _steps(self._t.settle_s)


class _Press:
    """Whether both hands have let go of what they pressed between them, and the whole body stands now."""

    def __init__(self, thresholds: Thresholds, body: Proprioception) -> None:
        self._t = thresholds
        self._presses = squeezes(body)
        self._otherwise = 0  # steps
        self._news = self._armed = self._stands = False

    def feel(self, body: Proprioception, stands: bool) -> None:
        """Take in one step; `stands`: the whole body is at rest."""
        self._otherwise = self._otherwise + 1 if squeezes(body) != self._presses else 0
        if self._otherwise >= _steps(self._t.hold_s):
            self._presses, self._otherwise = not self._presses, 0
            self._news = not self._presses
        self._stands = stands
        self._armed = self._armed or not stands

    @property
    def let_go(self) -> bool:
        """Whether they have, and press nothing since."""
        return self._news

    @property
    def due(self) -> bool:
        """Whether they have, and have moved and settled since that was last told of."""
        return self._news and self._armed and self._stands

    def fired(self) -> None:
        """The event was reported; it is due again only after the body has moved and settled."""
        self._armed = False


class _BaseArrival:
    """Whether the base has gone somewhere since the last arrival, and the whole body stands now."""

    def __init__(self, thresholds: Thresholds) -> None:
        self._t = thresholds
        self._left: Array | None = None  # (3,) base pose at the last arrival

    def arrived(self, body: Proprioception, stands: bool) -> bool:
        """Take in one step; `stands`: the whole body is at rest."""
        now = body.base_pose
        if not stands:
            return False
        if self._left is not None:
            gone_m, turned = norm((now - self._left)[:2]), abs(kinematics.wrap(now[2] - self._left[2]))
            if gone_m <= self._t.driven_m and turned <= self._t.turned_rad:
                return False
        self._left = now.copy()
        return True


class _ArmRest:
    """Whether the arms have gone somewhere since the last rest, and the whole body stands now."""

    def __init__(self, thresholds: Thresholds, body: Proprioception) -> None:
        self._t = thresholds
        self._home = {side: body.arm[side].copy() for side in body.sides}
        self._farthest: dict[Side, float] = dict.fromkeys(body.sides, 0.0)
        self._recent: deque[Array] = deque(maxlen=_STEPS_OF_A_RATE + 1)
        self._still = 0  # steps
        self.since_event = _LONG_AGO

    def feel(self, body: Proprioception, steady: bool) -> Side | None:
        """Take in one step. Returns the arm that went farthest, at a new rest; `steady`: the fingers are."""
        t = self._t
        for side in body.sides:
            away = float(np.abs(body.arm[side] - self._home[side]).max())
            self._farthest[side] = max(self._farthest[side], away)
        turn = np.array([np.cos(body.base_pose[2]), np.sin(body.base_pose[2])])  # yaw without its jump at pi
        now = np.concatenate([*(body.arm[side] for side in body.sides), body.torso, body.base_pose[:2], turn])
        self._recent.append(now)
        went = np.abs(now - self._recent[0]).max() * CONTROL_HZ
        self._still = 0 if went > t.arm_still_rad_s * max(len(self._recent) - 1, 1) else self._still + 1
        self.since_event += 1
        if not body.sides:
            return None
        farther = max(reversed(body.sides), key=self._farthest.__getitem__)
        return farther if steady and self.stands and self._farthest[farther] > t.moved_rad else None

    @property
    def stands(self) -> bool:
        """Whether arms, torso and base have been at rest for long enough."""
        return self.stands_for(self._t.settle_s)

    def stands_for(self, seconds: float) -> bool:
        """Whether they have been at rest for so long."""
        return self._still >= _steps(seconds)

    @property
    def told(self) -> bool:
        """Whether an event was reported since it came to stand."""
        return self.since_event < self._still

    def fired(self) -> None:
        """An event was reported: the next way begins where the arms are now."""
        if self._recent:
            ends = np.cumsum([len(home) for home in self._home.values()])
            self._home = dict(zip(self._home, np.split(self._recent[-1], ends), strict=False))  # the arms come first
        self._farthest = dict.fromkeys(self._home, 0.0)
        self.since_event = 0


def _told_m(body: Proprioception, side: Side) -> float:
    """The commanded width of a hand. Learned policies seldom command -1; careful ones open just enough."""
    return (body.gripper_command[side] + 1.0) * (body.open_m / 2)


def _steps(seconds: float) -> int:
    return max(1, round(seconds * CONTROL_HZ))
