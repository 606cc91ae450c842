"""Turns postures, hand lines and drives into actions, one a control step.

Every motion is a generator of (23,) actions. Whoever plays it writes what the robot feels into `Motion.felt` before
each step; the hand lines and drives are closed loops around that, and each motion stops where it is held off its way.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.rotations import angle, between, matrices, quaternion
from mpvi_bt.ground.geometry.solids import Array, Solid, pose
from mpvi_bt.ground.robot.action_rows import standing
from mpvi_bt.ground.robot.collision import Body
from mpvi_bt.ground.robot.drives import in_base_frame, legs
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Proprioception, Side
from mpvi_bt.ground.robot.robots import model_named
from mpvi_bt.ground.robot.squeeze import squeezes
from mpvi_bt.ground.robot.timing import schedule, timed

Actions = Iterator[Array]

# All our choice.
_LEAP_RAD = 0.4  # between neighbors 1 cm apart on a line: another elbow, not the next step
_HAND = np.array([[1.0, 1.0], [1.5, 4.0]])  # of a hand on a line: acceleration [m/s^2], turning [rad/s, rad/s^2]
_GENTLY = 0.35  # of the accelerations, for what holds something
BLOCKED_RAD = 0.06  # an arm held off its command by that much more than at the start has met something
_BLOCKED_BASE = np.array([0.06, 0.06, 0.12])  # [m, m, rad]
_ARRIVED_M = 0.03
_POST_M, _OFF_M = 0.05, 0.01  # what is taken to have held the base up: its radius, so far off where the base stands now
_NOTICED = 4  # control steps in a row
_RELEASED = 10  # control steps
_TOUCH_M = 0.005  # a hand that feels its way has met something when it is held up by that much


class MotionFailure(Exception):
    """A motion cannot go on.

    Attributes:
        reason: Stable code, such as "no_reach" or "arm_blocked".
        evidence: What was found, one line for a person; "" where the reason says all.
    """

    def __init__(self, reason: str, evidence: str = "") -> None:
        super().__init__(reason)
        self.reason, self.evidence = reason, evidence

    def __str__(self) -> str:
        return f"{self.reason} ({self.evidence})" if self.evidence else self.reason


def smooth(u: float) -> float:
    """0..1 eased at both ends."""
    return u * u * (3 - 2 * u)


@dataclass(frozen=True)
class GripTimes:
    """Durations of opening and closing a hand.

    Our choice: slow on a payload, as fast fingers bat light things away; faster with nothing between them.
    """

    take_s: float = 0.67  # on a payload that nothing else holds [s]
    firm_s: float = 0.5  # on a bar, or off what stays where it is [s]
    clear_s: float = 0.4  # off whatever it may hold when a motion failed [s]
    empty_s: float = 0.3  # with nothing between the fingers [s]
    preset_s: float = 0.2  # from one opening of an open hand to another [s]
    ready_s: float = 0.1  # of a hand that should be open already [s]


GRIP = GripTimes()


class Motion:
    """The robot's present command, and motions that change it.

    Attributes:
        felt: What the robot feels at this step; the player keeps it fresh.
        action: (A,) the command that the last yielded action carried.
        robot: What robot it is.
        layout: Of its actions.
        bumps: In the world, for what held the base up since it began: no camera may ever have shown that.
    """

    def __init__(self, felt: Proprioception) -> None:
        """Start from a robot as it stands."""
        self.felt, self.robot, self.bumps = felt, model_named(felt.robot), list[Solid]()
        self.layout = self.robot.layout
        self.action = standing(felt)

    @property
    def torso(self) -> Array:
        """(4,) commanded torso."""
        return self.action[self.layout.torso].copy()

    @property
    def posture(self) -> Array:
        """(4,) the posture of the trunk as commanded."""
        return self.robot.trunk.posture(self.torso)

    def bent(self, lift: float | None = None, pitch: float | None = None, tilt: float | None = None) -> Array:
        """The torso (4,) as commanded, but for these of its posture [m, rad]."""
        posture = self.posture
        for part, value in ((0, lift), (2, pitch), (3, tilt)):
            if value is not None:
                posture[part] = value
        return self.robot.trunk.joints(posture, near=self.torso)

    def arm(self, side: Side) -> Array:
        """(7,) commanded posture of an arm."""
        return self.action[self.layout.arm[side]].copy()

    def hand(self, side: Side) -> Array:
        """T_base_tcp (4, 4) as commanded."""
        return self.robot.tcp(self.torso, self.arm(side), side)

    def body(self) -> Body:
        """The robot as commanded, holding nothing, with nothing around it."""
        return Body(self.robot, self.torso, {side: self.arm(side) for side in self.robot.sides})

    def wait(self, seconds: float) -> Actions:
        """Stand still."""
        for _ in range(round(seconds * CONTROL_HZ)):
            yield self.still()

    def grip(self, side: Side, value: float, seconds: float = 0.6) -> Actions:
        """Move a gripper to `value` (-1 closed ... 1 open) at an even pace: fast fingers bat light things away."""
        i = self.layout.gripper[side]
        start, n = self.action[i], max(1, round(seconds * CONTROL_HZ))
        for k in range(1, n + 1):
            self.action[i] = start + (value - start) * k / n
            yield self.still()

    def follow(self, side: Side, path: Sequence[Array], speed: float = np.inf, gently: bool = True) -> Actions:
        """Move one arm through postures (7,), as fast as `speed` [rad/s] and the joints' limits allow.

        The corners of the path are rounded by up to 0.02 rad. What the hand holds is accelerated `gently`, or like an
        empty hand: a tool, in which nothing can be spilled.

        Raises:
            MotionFailure: "arm_blocked" if something holds the arm off its way.
        """
        watch = _Watch(self, [side])
        acceleration = self._acceleration(side) if gently else self.robot.arm_acceleration
        for q in timed(path, np.minimum(self.robot.arm_speed, speed), acceleration):
            self.action[self.layout.arm[side]] = q
            yield self.still()
            yield from watch.look()
        for _ in range(20):
            yield self.still()
            if np.abs(self.felt.arm[side] - self.arm(side)).max() < 0.02:
                return
        if np.abs(self.felt.arm[side] - self.arm(side)).max() > 0.08:
            raise MotionFailure("arm_blocked")

    def line(
        self, side: Side, T_base_tcp: Array, speed: float = 0.2, until_contact: bool = False,
        give_rad: float = BLOCKED_RAD,
    ) -> Generator[Array, None, bool]:  # fmt: skip
        """Move a hand along a straight line to a pose in the base frame.

        Args:
            side: The hand.
            T_base_tcp: (4, 4) where to.
            speed: Of the hand [m/s], at the most.
            until_contact: Feel the way: stop, without failing, where something holds the hand up. Slowly (0.05 m/s) it
                presses with some 20 N before it notices.
            give_rad: How far the arm may be held off its command; infinite for a hand that is meant to press.

        Returns:
            Whether the hand was held up on its way.

        Raises:
            MotionFailure: "no_reach" if the arm cannot stay on the line, "arm_blocked" if something holds it off.
        """
        start = self.hand(side)
        way = T_base_tcp[:3, 3] - start[:3, 3]
        ends = quaternion(start[:3, :3]), quaternion(T_base_tcp[:3, :3])
        length, turn = float(norm(way)), angle(*between(*ends, np.array([0.0, 1.0])))

        def pose(u: float) -> Array:
            return kin.transform(matrices(between(*ends, np.array([u])))[0], start[:3, 3] + way * u)

        watch = _Watch(self, [side], give_rad, way / max(length, 1e-9) if until_contact and length > 1e-6 else None)
        n = max(20, int(np.ceil(max(length / 0.01, turn / 0.03))))
        path = [np.append(self.arm(side), (0.0, 0.0))]
        for u in np.linspace(0, 1, n + 1)[1:]:
            path.append(np.append(self._reached(side, pose(float(u)), path[-1][:7]), (length * u, turn * u)))
        postures = np.stack(path)
        if length > 1e-6 or turn > 1e-6:
            limits = np.append(self.robot.arm_speed, (speed, _HAND[1, 0]))
            for place in schedule(postures, limits, np.append(self._acceleration(side), _HAND[:, 1])):
                i = min(int(place), n - 1)
                near = postures[i] + (postures[i + 1] - postures[i]) * (place - i)
                # From where the torso really is: under a load it gives way.
                self.action[self.layout.arm[side]] = self._reached(side, pose(float(place) / n), near[:7])
                yield self.still()
                if watch.touched():
                    self.action[self.layout.arm[side]] = self.felt.arm[side]
                    yield self.still()
                    return True
                yield from watch.look()
        for _ in range(4):
            self.action[self.layout.arm[side]] = self._reached(side, T_base_tcp, self.arm(side))
            yield self.still()
            yield from watch.look()
        return watch.touched()

    def stand(
        self, torso: Array, arms: Mapping[Side, Sequence[Array]] | None = None, give_rad: float = BLOCKED_RAD
    ) -> Actions:
        """Move the torso (4,) and meanwhile arms through evenly spaced postures (7,): what `arm_motion.sweep` plans.

        `give_rad` is how far arms may be held off their command: infinite for hands that are meant to press.

        Raises:
            MotionFailure: "torso_blocked" or "arm_blocked" if something holds them off their way.
        """
        arms = dict(arms or {})
        count = max([2, *(len(path) for path in arms.values())])
        u = np.linspace(0, 1, count)
        columns = [self.torso + (np.asarray(torso, float) - self.torso) * u[:, None]]
        robot = self.robot
        speeds, accelerations = [robot.torso_speed], [robot.torso_acceleration * self._ease(*robot.sides)]
        for side, path in arms.items():
            at = np.linspace(0, 1, len(path))
            columns.append(np.stack([np.interp(u, at, joint) for joint in np.transpose(path)], 1))
            speeds.append(self.robot.arm_speed)
            accelerations.append(self._acceleration(side))
        watch = _Watch(self, list(arms), give_rad, torso=True)
        rows = timed(np.concatenate(columns, 1), np.concatenate(speeds), np.concatenate(accelerations))
        for row in rows:
            self.action[self.layout.torso] = row[:4]
            for i, side in enumerate(arms):
                self.action[self.layout.arm[side]] = row[4 + 7 * i : 11 + 7 * i]
            yield self.still()
            yield from watch.look()
        if len(rows):
            yield from self.wait(0.15)

    def drive(self, goal: Array, speed: float = 0.5) -> Actions:
        """Drive the base straight to `goal` (3,) x, y [m], yaw [rad] in the world, at most `speed` [m/s] and 1 rad/s.

        A base that cannot go sideways turns, goes straight ahead or back, and turns again.

        Raises:
            MotionFailure: "base_blocked" if something holds it off its way, or it does not arrive within 3 cm and
                0.05 rad; what it met is among the `bumps` then.
        """
        for leg in legs(self.robot, self.felt.base_pose, goal):
            yield from self._leg(leg, speed)
        off = goal - self.felt.base_pose
        far, turn = float(norm(off[:2])), abs(float(kin.wrap(off[2])))
        if far > _ARRIVED_M or turn > 0.05:
            raise MotionFailure("base_blocked", f"{100 * far:.0f} cm and {np.degrees(turn):.0f} degrees off its goal")

    def _leg(self, goal: Array, speed: float) -> Actions:
        """One straight leg of a drive; it ends where something holds the base off its way."""
        start = self.felt.base_pose.copy()
        change = np.append(goal[:2] - start[:2], kin.wrap(goal[2] - start[2]))
        travel = float(norm(change[:2]))
        limit, ease = np.array([speed, 1.0]), self._ease(*self.robot.sides)
        u = timed([np.zeros(2), np.array([travel, abs(change[2])])], limit, self.robot.drive_acceleration * ease)
        done = np.max(u / np.maximum(u[-1:], 1e-9), axis=1) if len(u) else np.ones(1)
        lost, before = 0, 0.0
        for k in range(len(done) + 60):
            reference = start + change * before
            ahead = float(done[min(k, len(done) - 1)])
            forward, before = change * (ahead - before) * CONTROL_HZ, ahead
            error = reference - self.felt.base_pose
            error[2] = kin.wrap(error[2])
            aside = np.array([-np.sin(start[2]), np.cos(start[2])])
            left = error[:2] if self.robot.sideways else error[:2] - aside * matmul(aside, error[:2])
            if k >= len(done) and norm(left) < 0.006 and abs(error[2]) < 0.01:
                break
            lost = lost + 1 if (np.abs(error) > _BLOCKED_BASE).any() else 0
            if lost >= _NOTICED:
                break
            yield self._moving(forward + 3.0 * error)
        if norm(left) > _ARRIVED_M:
            self.bumps += self._met(left)
        yield self.still()

    def _met(self, way: Array) -> list[Solid]:
        """Posts on the floor before the base, where it would go `way` (2,) and something does not let it.

        One right before it. Of a base with corners any of what leads may be held up, to the side of its middle: a row.
        """
        hull, toward = self.robot.hull, way / norm(way)
        low = hull.standing[hull.standing[:, 2] < hull.base[1]]
        turn = kin.rot_z(float(self.felt.base_pose[2]))[:2, :2]
        ahead = matmul(turn.T, toward)
        along, across, off = matmul(low[:, :2], ahead), matmul(low[:, :2], [-ahead[1], ahead[0]]), _POST_M + _OFF_M
        if len(self.robot.base.corners):
            row = np.linspace(across.min(), across.max(), 1 + int(np.ceil(np.ptp(across) / (2 * _POST_M))))
            beside = np.abs(row[:, None] - across)
            leads = along + np.sqrt(np.maximum((low[:, 3] + off) ** 2 - beside**2, 0.0))
            away = np.where(beside < low[:, 3] + off, leads, -np.inf).max(1)
        else:
            row, away = np.zeros(1), np.array([(along + low[:, 3]).max() + _POST_M + _OFF_M])
        half = hull.base[1] / 2
        places = self.felt.base_pose[:2] + np.outer(away, toward) + np.outer(row, [-toward[1], toward[0]])
        return [
            Solid("cylinder", np.array([_POST_M, _POST_M, half]), pose((float(x), float(y), float(half))))
            for x, y in places
        ]

    def _reached(self, side: Side, T_base_tcp: Array, near: Array) -> Array:
        """The arm posture nearest to `near` for a hand pose, at the torso's present posture."""
        torso = self.felt.torso if np.abs(self.felt.torso - self.torso).max() < 0.02 else self.torso
        q = self.robot.nearest_posture(matmul(kin.inverse(self.robot.chest(torso)), T_base_tcp), side, near)
        if q is None or np.abs(q - near).max() > _LEAP_RAD:
            raise MotionFailure("no_reach")
        return q

    def _ease(self, *sides: Side) -> float:
        return _GENTLY if any(self.felt.holds(s) for s in sides) or squeezes(self.felt) else 1.0

    def _acceleration(self, side: Side) -> Array:
        return self.robot.arm_acceleration * self._ease(side)

    def still(self) -> Array:
        """The present command, the base standing."""
        self.layout.set_velocity(self.action, 0.0)
        return self.action.copy()

    def _moving(self, velocity_world: Array) -> Array:
        yaw = float(self.felt.base_pose[2])
        self.layout.set_velocity(self.action, in_base_frame(self.robot, velocity_world, yaw))
        return self.action.copy()


class _Watch:
    """Detects, from proprioception, that arms or torso are blocked on their path.

    What they give way to from the start, a load or a squeeze, is no hindrance. Nor is their lead: with the velocity
    fed forward they are half a step ahead of a moving target.
    """

    def __init__(
        self, motion: Motion, sides: Sequence[Side], give_rad: float = BLOCKED_RAD, along: Array | None = None,
        torso: bool = False,
    ) -> None:  # fmt: skip
        self._motion, self._sides, self._give, self._along, self._torso = motion, sides, give_rad, along, torso
        self._told: dict[str, Array] = {}
        self._off = self._measured()
        self._blocked, self._touching = 0, 0
        self._behind = self._held_up()

    def look(self) -> Actions:
        """To be called after each step. Lets go of the push and raises MotionFailure where the way is barred."""
        now = self._measured()
        reasons = ["arm_blocked" for s in self._sides if np.abs(now[s] - self._off[s]).max() > self._give]
        if self._torso and (np.abs(now["torso"] - self._off["torso"]) > self._motion.robot.torso_give).any():
            reasons.append("torso_blocked")
        self._blocked = self._blocked + 1 if reasons else 0
        if self._blocked < _NOTICED:
            return
        motion = self._motion
        for _ in range(_RELEASED):  # at once it would spring back, and fling what is held
            for side in self._sides:
                arm = motion.layout.arm[side]
                motion.action[arm] += 0.3 * (motion.felt.arm[side] - self._off[side] - motion.action[arm])
            if self._torso:
                torso = motion.layout.torso
                motion.action[torso] += 0.3 * (motion.felt.torso - self._off["torso"] - motion.action[torso])
            yield motion.still()
        raise MotionFailure(reasons[0])

    def touched(self) -> bool:
        """Whether a hand that feels its way is held up, at two steps in a row."""
        if self._along is None:
            return False
        self._touching = self._touching + 1 if self._held_up() - self._behind > _TOUCH_M else 0
        return self._touching >= 2

    def _measured(self) -> dict[str, Array]:
        motion, off = self._motion, {"torso": self._motion.felt.torso - self._motion.torso}
        for side in self._sides:
            told = motion.arm(side)
            off[side] = motion.felt.arm[side] - told - (told - self._told.get(side, told)) / 2
            self._told[side] = told
        return off

    def _held_up(self) -> float:
        if self._along is None:
            return 0.0
        motion, side = self._motion, self._sides[0]
        felt = motion.robot.tcp(motion.felt.torso, motion.felt.arm[side], side)
        return float(matmul((motion.hand(side) - felt)[:3, 3], self._along))
