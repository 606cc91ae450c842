"""Joints of a robot's file that are commanded together: a torso, an arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.marked_yaml import Location
from mpvi_bt.ground.robot.robot_file import GroupPart
from mpvi_bt.ground.robot.robot_findings import RobotFindings
from mpvi_bt.ground.robot.urdf_tree import UrdfJoint

_ENDLESS_RAD = 3.1  # our choice: joints that turn on without end stop before half a turn, so that no path winds up


@dataclass(frozen=True, eq=False)
class JointGroup:
    """Joints that are commanded together: (n,) names, limits (n, 2), top speeds (n,), travel posture (n,)."""

    joints: tuple[str, ...]
    limits: Array
    speed: Array
    travel: Array


def read_group(findings: RobotFindings, part: GroupPart, at: Location, group: str) -> JointGroup:
    """The joints of a part of the file; `group` is its name for a person."""
    count = len(part.joints)
    joints = [findings.take(name, (*at, "joints", i), group) for i, name in enumerate(part.joints)]
    for key in ("limits", "speed", "travel"):
        given = getattr(part, key)
        if isinstance(given, list) and len(given) != count:
            findings.tell((*at, key), "wrong-length", f"{len(given)} of {count} joints: one for each, in their order")
            return JointGroup((), np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    limits, speed, travel = np.zeros((count, 2)), np.ones(count), np.zeros(count)
    for i, joint in enumerate(joints):
        if joint is None:
            continue
        narrowed = part.limits[i] if part.limits is not None else None
        limits[i] = _limits(findings, joint, narrowed, (*at, "limits", i), (*at, "joints", i))
        top = part.speed[i] if isinstance(part.speed, list) else part.speed or joint.velocity
        if not top:
            message = f"the URDF says no speed of joint {joint.name!r}: give `speed`, of all joints or of each"
            findings.tell((*at, "joints", i), "missing-key", message)
        speed[i] = top or 1.0
        travel[i] = np.clip(0.0, *limits[i]) if part.travel is None else part.travel[i]
        if not limits[i, 0] <= travel[i] <= limits[i, 1]:
            message = f"joint {joint.name!r} goes from {limits[i, 0]:g} to {limits[i, 1]:g}, not to {travel[i]:g}"
            findings.tell((*at, "travel", i), "out-of-range", message)
    return JointGroup(tuple(part.joints), limits, speed, travel)


def _limits(
    findings: RobotFindings, joint: UrdfJoint, given: tuple[float, float] | None, at: Location, named: Location
) -> tuple[float, float]:
    own = joint.limits
    if given is None:
        if own is not None:
            return own
        if joint.kind == "continuous":
            return -_ENDLESS_RAD, _ENDLESS_RAD
        findings.tell(
            named, "missing-key", f"the URDF has no limits of joint {joint.name!r}: give `limits` of the group"
        )
        return 0.0, 0.0
    if given[0] > given[1]:
        findings.tell(at, "out-of-range", f"the lowest, {given[0]:g}, is above the highest, {given[1]:g}")
    elif own is not None and not own[0] <= given[0] <= given[1] <= own[1]:
        message = f"the URDF has joint {joint.name!r} go from {own[0]:g} to {own[1]:g}: limits may only be narrower"
        findings.tell(at, "out-of-range", message)
    return given


def spread_group(torso: JointGroup, order: Sequence[str | None]) -> JointGroup:
    """A torso with 0 for numbers that no joint follows."""
    where = [i for i, name in enumerate(order) if name is not None]
    limits, speed, travel = np.zeros((len(order), 2)), np.ones(len(order)), np.zeros(len(order))
    limits[where], speed[where], travel[where] = torso.limits, torso.speed, torso.travel
    return JointGroup(torso.joints, limits, speed, travel)
