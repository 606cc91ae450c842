"""How a learned skill acts: it proposes where to stand and how to hold the hand, then moves there, chunk by chunk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.hands.learned.features import STRIDE, WAYPOINT, WAYPOINTS, Moments, TargetFrame, actor_inputs, hand_at
from mpvi_bt.hands.learned.mirroring import BODY, SIDE
from mpvi_bt.hands.learned.network import Networks
from mpvi_bt.hands.learned.points import TARGET_POINTS

CHUNK = 9  # steps; our choice, measured: asking after 4 was worse
_PROPOSED_POINTS = 48  # of each set that the proposer was trained with
_BENT = 2.0  # how much likelier a hypothesis must be for each radian that the arm must deviate from it
_NEAR_M = 0.3  # of the target the hand's shift and turn count, farther away the joints
_TOP_BASE = np.array([0.6, 0.6, 1.2])  # [m/s, m/s, rad/s]
_TOP_ARM_RAD = 0.085  # of a step
_OPENED = 0.9  # a command of the gripper that lets go
_TORSO_STEP = np.array([0.15, 0.4, 0.4]) / CONTROL_HZ  # lift [m], yaw, pitch [rad]
_OFF_RAD = 0.4  # a posture of the hand's pose that is farther from the joints' is not taken
_RESTED_M, _RESTED_RAD, _ELSEWHERE_M, _ELSEWHERE_RAD = 0.003, 0.003, 0.35, 0.4
_OUT_RAD = 0.3  # an arm so far from its travel posture is on its way
_REBASED_RAD = 0.6
_BEGIN_M = (0.65, 1.15)  # from the target, where demonstrations began
_DRIVE_M = 0.6  # that demonstrations drove at most, by and large
_EPSILON_M = 1e-6
# Our choice: changes of lift [m], yaw, pitch and the head's tilt [rad], the least first.
_LEANS = np.array(
    sorted(
        (
            (lift, 0.0, pitch, 0.0)
            for lift in (0.0, -0.05, 0.05, -0.1, 0.1)
            for pitch in (0.0, 0.1, 0.2, 0.3, 0.4, -0.1, -0.2)
        ),
        key=lambda lean: 2 * abs(lean[0]) + abs(lean[2]),
    )
)


# (9, 9) how much of now and of each waypoint every step of a chunk has.
_BETWEEN = np.maximum(1 - np.abs(np.arange(1, CHUNK + 1)[:, None] / STRIDE - np.arange(WAYPOINTS + 1)), 0)

Step = tuple[Array, Array, Array, float]


@dataclass(frozen=True)
class Leading:
    """How a proposed place is turned into motion; a payload released beside the place cannot be taken back.

    A hand lower than the place is raised over it first; otherwise the container or its table would strip off the
    payload. Then the base drives there with the arm at rest; near its pose the hand goes over the place, then
    down, opens only there, and goes up again. Our choice, by trials.
    """

    parked_m: float = 0.03  # the base stands at the stance if it is no farther off [m]
    parked_rad: float = 0.05  # and turned by no more [rad]
    drive_s: float = 0.6  # the speed is the remaining way divided by this [s]
    drive: tuple[float, float, float] = (0.4, 0.4, 0.8)  # largest speed: x, y [m/s], yaw [rad/s]
    near_m: float = 0.45  # the hand is led when the base is closer to its pose [m]
    arm_rad: float = 0.03  # largest change of a joint per step [rad]
    beside_m: float = 0.1  # sideways distance of a hand from its pose above which it goes over first [m]
    over_m: float = 0.12  # height of that way over the pose [m]
    under_m: float = 0.03  # a hand this far below its pose rises before the base drives [m]
    there_m: float = 0.04  # largest distance from its pose at which a hand may open [m]


_LEAD = Leading()


def propose(
    net: Networks, now: Moments, begun: Array, points: Array, most: int, nth: int, here: bool
) -> Array | None:  # fmt: skip
    """(1, 14) the likeliest stance whose hand pose the arm can reach; None if there is none.

    Args:
        net: Of the skill.
        now: One moment.
        begun: (1, 3) where the base was when the skill began: stances are proposed as seen from there.
        points: (128, 3) of the world.
        most: How many hypotheses, the likeliest ones, are considered.
        nth: Which in that order; the last one if there are fewer.
        here: Whether the base stays where it is.
    """
    some = np.concatenate([points[:_PROPOSED_POINTS], points[TARGET_POINTS : TARGET_POINTS + _PROPOSED_POINTS]])[None]
    frame = TargetFrame.of(_within(begun, points[:_PROPOSED_POINTS].mean(0)), some, _PROPOSED_POINTS)
    hypotheses, likely = net.propose(frame.points(some), frame.told, _PROPOSED_POINTS)
    stances, hands = frame.stance(hypotheses)
    found = []
    for k in np.argsort(-likely)[:most]:
        stance, hand, log_likely = stances[k], hands[k], likely[k]
        at = bent(np.concatenate([now.base[0], stance[3:]]) if here else stance, hand)
        if at is not None:
            off = float(np.abs(at[7:] - stance[7:]).max())
            found.append((log_likely - _BENT * off, at))
    found.sort(key=lambda f: -f[0])
    return found[min(nth, len(found) - 1)][1][None] if found else None


def _within(base: Array, target: Array) -> Array:
    """(1, 3) a base brought, on the line to a target (3,), to a distance that there are demonstrations from."""
    away = base[0, :2] - target[:2]
    far_m = max(float(norm(away)), _EPSILON_M)
    at = target[:2] + away / far_m * np.clip(far_m, *_BEGIN_M)
    return np.array([[*at, base[0, 2]]])


def ahead(now: Moments, stance: Array) -> Array:
    """(1, 14) the stance; where its base is farther away than in demonstrations, one on the way there."""
    way = stance[0, :2] - now.base[0, :2]
    far_m = float(norm(way))
    if far_m <= _DRIVE_M:
        return stance
    on_way = stance.copy()
    on_way[0, :2] = now.base[0, :2] + way * _DRIVE_M / far_m
    return on_way


def there(stance: Array, hand: Array) -> bool:
    """Whether a hand at (3,) in the world may open: it is at the stance's pose."""
    return bool(norm(hand_at(stance)[0, :3, 3] - hand) < _LEAD.there_m)


def reached(stance: Array, hand: Array) -> Array | None:
    """(14,) the stance with the nearest posture of the arm that brings the hand to (4, 4) in the world, or None."""
    T_chest = matmul(kin.base(stance[:3]), BODY.chest(stance[3:7]))
    q = BODY.nearest_posture(matmul(kin.inverse(T_chest), hand), SIDE, stance[7:14])
    return None if q is None else np.concatenate([stance[:7], q])


def bent(stance: Array, hand: Array) -> Array | None:
    """As `reached`; where the arm is too short, the torso is bent and raised as little as makes it long enough."""
    for lean in _LEANS:
        at = stance.copy()
        at[3:7] = np.clip(at[3:7] + lean, *BODY.torso_limits.T)
        if (found := reached(at, hand)) is not None:
            return found
    return None


def rebased(now: Moments, stance: Array) -> Array:
    """(1, 14) the stance with the same hand pose from where the base has come to rest, a little off."""
    base, g = now.base[0], stance[0]
    off_m, off_rad = float(norm(g[:2] - base[:2])), abs(float(kin.wrap(g[2] - base[2])))
    out = float(np.abs(now.arm[0] - BODY.travel_arm[SIDE]).max())
    if out < _OUT_RAD or off_m > _ELSEWHERE_M or off_rad > _ELSEWHERE_RAD:
        return stance
    if off_m < _RESTED_M and off_rad < _RESTED_RAD:
        return stance
    hand = matmul(kin.base(g[:3]), BODY.tcp(g[3:7], g[7:14], SIDE))
    at = bent(np.concatenate([base, g[3:]]), hand)
    return stance if at is None or np.abs(at[7:] - g[7:]).max() >= _REBASED_RAD else at[None]


def _drive(now: Moments, stance: Array) -> Array | None:
    """(3,) the base's velocity toward the stance's, None where it stands there."""
    off = matmul(kin.inverse(now.frames[0]), kin.base(stance[0, :3]))
    way = np.array([off[0, 3], off[1, 3], np.arctan2(off[1, 0], off[0, 0])])
    if float(norm(way[:2])) < _LEAD.parked_m and abs(way[2]) < _LEAD.parked_rad:
        return None
    return np.clip(way / _LEAD.drive_s, -np.array(_LEAD.drive), _LEAD.drive)


def _raised(now: Moments, goal: Array) -> Array | None:
    """(7,) the arm's posture for a hand that is told to be lower than over its goal (4, 4), as high as the arm reaches.

    None where it is high enough, or as high as it gets.
    """
    T = BODY.tcp(now.told_torso, now.told_arm, SIDE)[0]
    T_chest_base = kin.inverse(BODY.chest(now.told_torso[0]))
    for height_m in np.arange(goal[2, 3] + _LEAD.over_m, T[2, 3] + _LEAD.under_m, -_LEAD.under_m):
        T[2, 3] = height_m
        if (arm := BODY.nearest_posture(matmul(T_chest_base, T), SIDE, now.told_arm[0])) is not None:
            return arm
    return None


def _over(stance: Array, goal: Array, hand: Array, opened: bool) -> Array:
    """(7,) the arm's posture for a hand at (3,): the stance's; from beside it, and once it has opened, above that."""
    if opened or float(norm(goal[:2, 3] - hand[:2])) > _LEAD.beside_m:
        goal = goal.copy()
        goal[2, 3] += _LEAD.over_m
    at = reached(stance[0], goal)
    return stance[0, 7:] if at is None else at[7:]


def chunk(
    net: Networks, now: Moments, stance: Array, points: Array, before: bool, opens: bool
) -> tuple[list[Step], float]:  # fmt: skip
    """The next steps: base velocity (3,), torso (4,), arm (7,) and gripper of each; and the progress, 0 to 1.

    Args:
        net: Of the skill.
        now: One moment.
        stance: (1, 14) to come to.
        points: (128, 3) of the world.
        before: Whether the hand has yet to close or to open.
        opens: Whether it is to open.
    """
    told, seen = actor_inputs(now, stance, points[None], TARGET_POINTS)[::-1]
    answer, progress = net.act(seen, told, TARGET_POINTS)
    way = np.concatenate([np.zeros((1, answer.shape[1])), answer])  # the first point is now
    way[0, WAYPOINT["grip"]] = now.told_grip
    hand, goal = now.hands_in_world[0, :3, 3], hand_at(stance)[0]
    away_m = norm(points[:TARGET_POINTS].mean(0) - hand)
    near, led = away_m < _NEAR_M, before and opens
    to_goal_m = norm(goal[:3, 3] - hand)
    drive = _drive(now, stance) if led else None
    opened = opens and now.told_grip[0] > _OPENED
    over = _over(stance, goal, hand, opened) if opened or (led and to_goal_m < _LEAD.near_m) else None
    ways = matmul(_BETWEEN, way)
    torso = now.told_torso + ways[:, WAYPOINT["torso"]]
    if before and (near or (led and drive is None)):  # the actor seldom bends, even where the arm is too short
        torso[:, :3] = now.told_torso[:, :3] + _within_steps(stance[0, 3:6] - now.told_torso[0, :3], _TORSO_STEP)
    wanted = now.told_arm + ways[:, WAYPOINT["arm"]]
    raised = _raised(now, goal) if drive is not None else None
    if raised is not None:
        drive, wanted = np.zeros(3), now.told_arm + _within_steps(raised - now.told_arm[0], _LEAD.arm_rad)
    elif drive is not None:
        wanted = np.repeat(now.told_arm, CHUNK, 0)
    elif over is not None:
        wanted = now.told_arm + _within_steps(over - now.told_arm[0], _LEAD.arm_rad)
    elif near:
        wanted = _with_hand(now, torso, ways, wanted)
    base = _speeds(way[:1], ways) if drive is None else np.repeat(drive[None], CHUNK, 0)
    free, steps, arm = not led or there(stance, hand), list[Step](), now.told_arm[0]
    for k in range(CHUNK):
        arm = arm + np.clip(wanted[k] - arm, -_TOP_ARM_RAD, _TOP_ARM_RAD)
        grip = float(np.clip(ways[k, WAYPOINT["grip"]][0], -1, 1)) if free else now.told_grip[0]
        steps.append((base[k], torso[k], arm, grip))
    return steps, progress


def _within_steps(way: Array, step: Array | float) -> Array:
    """(9, n) how far of a way (n,) every step of a chunk is, of which each goes no farther than `step`."""
    most = np.arange(1, CHUNK + 1)[:, None] * step
    return np.clip(way, -most, most)


def _speeds(begin: Array, ways: Array) -> Array:
    """(9, 3) the base's velocity at every step, in its frame, from waypoint (1, 21) on by (9, 21)."""
    last = np.concatenate([begin, ways[:-1]])[:, WAYPOINT["base"]]
    x, y, yaw = (ways[:, WAYPOINT["base"]] - last).T
    c, s = np.cos(last[:, 2]), np.sin(last[:, 2])
    return np.clip(np.stack([c * x + s * y, c * y - s * x, yaw], 1) * CONTROL_HZ, -_TOP_BASE, _TOP_BASE)


def _with_hand(now: Moments, torso: Array, ways: Array, wanted: Array) -> Array:
    """(9, 7) the arm's postures that bring the hand where waypoints say, `wanted` where none is near to it."""
    turns = Rotation.from_rotvec(ways[:, WAYPOINT["turn"]]).as_matrix()
    shifts = kin.transform(turns, ways[:, WAYPOINT["shift"]])
    T_told = BODY.tcp(now.told_torso, now.told_arm, SIDE)[0]
    T_chest_hand = matmul(kin.inverse(BODY.chest(torso)), T_told, shifts)
    found = (BODY.nearest_posture(T, SIDE, at) for T, at in zip(T_chest_hand, wanted, strict=True))
    return np.array(
        [at if q is None or np.abs(q - at).max() >= _OFF_RAD else q for q, at in zip(found, wanted, strict=True)]
    )
