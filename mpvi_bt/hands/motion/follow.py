"""Going along a course with the whole robot: the base follows the hand's goal, the arm is solved anew at every step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.drives import in_base_frame
from mpvi_bt.ground.robot.motion import Actions, Motion, MotionFailure, smooth
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Side
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.stance.course import Course, CourseStart


@dataclass(frozen=True)
class Following:
    """How the whole robot follows a course.

    Our choice: slow enough that friction holds what is led.
    """

    base_gain: float = 3.0  # gain of the base [1/s]; without feed-forward of the goal's velocity it trails by a third
    base_speed_m_s: float = 0.28  # largest speed of the base [m/s]
    hand_speed_m_s: float = 0.30  # largest speed of the hand [m/s]
    turn_speed_rad_s: float = 0.6  # largest turning speed of the base [rad/s]
    step_rad: float = 0.12  # largest move of a joint's target per step [rad]
    leap_rad: float = 0.6  # joint change above which the elbow flips [rad]
    settling_steps: int = 15  # steps at the end of a course
    lost_steps: int = 5  # a hand out of reach for this many steps has lost the course
    off_m: float = 0.15  # retreat of a hand from what its fingers stand around [m]
    level: float = 0.3  # least horizontal part of the approach [ratio]; a steeper hand is raised instead
    between_m: float = 0.03  # half the width that is checked between open fingers [m]
    touched_m: float = 0.005  # distance that a touched thing holds a hand off its target [m]
    astray_m: float = 0.12  # a base this far from its goal is held up [m]
    back: float = 0.2  # it then goes back this part of the course [ratio]
    pushing: float = 1.6  # a pushing hand is this many times slower; a base that trails it leads a stretched arm astray


FOLLOW = Following()


def take_up(work: Work, start: CourseStart, side: Side, idle: Side | None) -> Actions:
    """Go to where a course begins, the hand short of the touch.

    Raises:
        MotionFailure: "base_blocked" or "arm_blocked".
    """
    motion = work.motion
    for pose in start.route:
        yield from motion.drive(pose)
    if idle is not None and len(start.aside) > 1:
        yield from motion.follow(idle, start.aside, speed=0.8)
    yield from motion.stand(start.torso, start.level)
    yield from motion.follow(side, start.path)
    yield from motion.drive(start.base, speed=0.3)


def touch(work: Work, course: Course, side: Side, speed: float = 0.16, until_contact: bool = False) -> Actions:
    """Bring the hand to where the course begins, in a straight line from wherever the base really stands.

    With `until_contact` it stops where something holds it up: what was only seen may be nearer.

    Raises:
        MotionFailure: "no_reach" if the arm cannot.
    """
    yield from work.motion.line(side, matmul(kin.inverse(work.base), course.hand(0.0)), speed, until_contact)


def go_along(
    motion: Motion,
    course: Course,
    side: Side,
    torso_after: Array,
    arrived: Callable[[float], bool],
    slowness: float = 1.0,
) -> Actions:
    """Go along a course with the hand, from where the base stands now.

    Args:
        motion: The robot.
        course: What the hand does.
        side: The hand.
        torso_after: (4,) the torso at the end.
        arrived: Called at every step with the progress 0..1: whether to stop there. Raises MotionFailure when
            something is amiss.
        slowness: How many times slower than usual.

    Raises:
        MotionFailure: "off_course" if the arm cannot keep up, "base_blocked" if the base cannot, which has gone back a
            little by then, or what `arrived` raises.
    """
    start, torso = motion.felt.base_pose.copy(), motion.torso
    n = max(10, round(_seconds(course, start) * slowness * CONTROL_HZ))
    lost, last = 0, start
    for k in range(1, n + FOLLOW.settling_steps + 1):
        x = smooth(min(1.0, k / n))
        goal = course.base(x, start)
        forward = (goal - last) * CONTROL_HZ
        error = goal - motion.felt.base_pose
        error[2], forward[2] = kin.wrap(error[2]), kin.wrap(goal[2] - last[2]) * CONTROL_HZ
        last = goal
        if norm(error[:2]) > FOLLOW.astray_m:  # pressed against a wall it could not even draw its hand back
            yield from motion.drive(course.base(smooth(max(0.0, k / n - FOLLOW.back)), start), FOLLOW.base_speed_m_s)
            raise MotionFailure("base_blocked", f"{100 * norm(error[:2]):.0f} cm off its course")
        motion.action[motion.layout.torso] = torso + (torso_after - torso) * x
        lost = 0 if _reach(motion, side, course.hand(x)) else lost + 1
        if lost >= FOLLOW.lost_steps:
            raise MotionFailure("off_course")
        yield _moving(motion, forward + FOLLOW.base_gain * error)
        if arrived(x):
            break
    motion.still()


def resistance(motion: Motion, side: Side) -> float:
    """How far a hand is from where its arm is told to have it [m]: the arm is a spring, and something holds it off."""
    felt = motion.robot.tcp(motion.felt.torso, motion.felt.arm[side], side)
    return float(norm((felt - motion.hand(side))[:3, 3]))


def back_out(motion: Motion, direction: Array, distance_m: float, speed: float = 0.25) -> Actions:
    """Move the base, arms as they are, along a direction (2,) in the world.

    Raises:
        MotionFailure: "base_blocked" if something is in the way.
    """
    goal = motion.felt.base_pose.copy()
    goal[:2] += direction / max(float(norm(direction)), 1e-9) * distance_m
    yield from motion.drive(goal, speed)


def around(work: Work, side: Side) -> bool:
    """Whether the fingers of a hand that points ahead stand around something that the robot does not carry."""
    T = matmul(work.base, work.motion.hand(side))
    between = T[:3, 3] + np.outer(np.linspace(-1, 1, 5) * FOLLOW.between_m, T[:3, 1])
    return bool(np.hypot(*T[:2, 2]) > FOLLOW.level and (work.near().distance(between) < FOLLOW.touched_m).any())


def draw_off(work: Work, side: Side) -> Actions:
    """Have the base draw a hand that points ahead straight back, arms as they are.

    Raises:
        MotionFailure: "base_blocked" if something is in the way.
    """
    yield from back_out(work.motion, -matmul(work.base, work.motion.hand(side))[:2, 2], FOLLOW.off_m)


def _seconds(course: Course, start: Array) -> float:
    """How long a course takes: base and hand have their speeds, and neither is to be outrun."""
    xs = np.linspace(0, 1, 21)
    bases, hands = [course.base(float(x), start) for x in xs], [course.hand(float(x)) for x in xs]
    way = sum(float(norm((b - a)[:2])) for a, b in pairwise(bases))
    reach = sum(float(norm((b - a)[:3, 3])) for a, b in pairwise(hands))
    turn = sum(
        float(np.arccos(np.clip((np.trace(matmul(a[:3, :3].T, b[:3, :3])) - 1) / 2, -1, 1))) for a, b in pairwise(hands)
    )
    return max(way / FOLLOW.base_speed_m_s, reach / FOLLOW.hand_speed_m_s, turn / FOLLOW.turn_speed_rad_s)


def _reach(motion: Motion, side: Side, T_world_tcp: Array) -> bool:
    """Turn the arm's targets toward a hand pose, seen from where base and torso really are; False if it is far off.

    The arm stays where it is then: on its way to another elbow the hand would swing what it holds.
    """
    T_chest_world = kin.inverse(matmul(kin.base(motion.felt.base_pose), motion.robot.chest(motion.felt.torso)))
    now = motion.arm(side)
    q = motion.robot.nearest_posture(matmul(T_chest_world, T_world_tcp), side, now)
    if q is None or np.abs(q - now).max() > FOLLOW.leap_rad:
        return False
    motion.action[motion.layout.arm[side]] = now + np.clip(q - now, -FOLLOW.step_rad, FOLLOW.step_rad)
    return True


def _moving(motion: Motion, velocity_world: Array) -> Array:
    yaw = float(motion.felt.base_pose[2])
    motion.layout.set_velocity(motion.action, in_base_frame(motion.robot, velocity_world, yaw))
    return motion.action.copy()
