"""The grippers of a robot's file: how far they open, and where their joints are then."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.marked_yaml import Location
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.ground.robot.robot_file import GripperPart
from mpvi_bt.ground.robot.robot_findings import RobotFindings
from mpvi_bt.ground.robot.urdf_tree import UrdfJoint, UrdfTree

_SAME_M = 1e-6  # grippers open equally wide


@dataclass(frozen=True, eq=False)
class Fingers:
    """A gripper: how far it opens [m], and (n, 2) the positions of its joints, closed and open."""

    opening_m: float
    ends: Array


def read_grippers(findings: RobotFindings, grippers: Mapping[Side, GripperPart], base_link: str) -> dict[Side, Fingers]:
    """The grippers; tells what does not fit."""
    found = {side: _read(findings, part, side) for side, part in grippers.items()}
    for side, part in grippers.items():
        findings.check_frame(("grippers", side, "tcp"), part.tcp, base_link)
    openings = [fingers.opening_m for fingers in found.values()]
    if not findings.any() and openings and max(openings) - min(openings) > _SAME_M:
        message = "both grippers have to open equally wide (`opening_m`)"
        findings.tell(("grippers",), "out-of-range", message, key=True)
    return found


def _read(findings: RobotFindings, part: GripperPart, side: Side) -> Fingers:
    at: Location = ("grippers", side)
    group = f"the {side} gripper"
    joints = [findings.take(name, (*at, "joints", i), group) for i, name in enumerate(part.joints)]
    ends = _ends(findings, part, at, joints)
    if part.opening_m is not None:
        opening_m = part.opening_m
    else:
        if not joints:
            message = "without joints it needs `opening_m`, how far its fingers are apart when open [m]"
            findings.tell(at, "missing-key", message, key=True)
        if any(joint is not None and joint.kind != "prismatic" for joint in joints):
            message = "its fingers turn: give `opening_m`, how far they are apart when open [m]"
            findings.tell(at, "missing-key", message, key=True)
        opening_m = sum(
            abs(float(ends[i, 1] - ends[i, 0])) * _followed(findings.tree, joint)
            for i, joint in enumerate(joints) if joint is not None
        )  # fmt: skip
    if not findings.any() and (ends[:, 0] == ends[:, 1]).any():
        findings.tell(at, "out-of-range", "open and closed are the same", key=True)
    return Fingers(opening_m, ends)


def _ends(findings: RobotFindings, part: GripperPart, at: Location, joints: list[UrdfJoint | None]) -> Array:
    """(n, 2) positions of the joints, closed and open."""
    ends = np.zeros((len(joints), 2))
    for i, joint in enumerate(joints):
        if joint is not None and joint.limits is not None:
            ends[i] = sorted(joint.limits, key=abs)
        elif joint is not None and (part.open is None or part.closed is None):
            message = f"the URDF has no limits of joint {joint.name!r}: give `open` and `closed` of the gripper"
            findings.tell((*at, "joints", i), "missing-key", message)
    for k, key in enumerate(("closed", "open")):
        if (given := getattr(part, key)) is None:
            continue
        if len(given) != len(joints):
            findings.tell((*at, key), "wrong-length", f"{len(given)} positions of {len(joints)} joints")
            continue
        for i, joint in enumerate(joints):
            low, high = (-np.inf, np.inf) if joint is None or joint.limits is None else joint.limits
            if joint is not None and not low <= given[i] <= high:
                message = f"joint {joint.name!r} goes from {low:g} to {high:g}, not to {given[i]:g}"
                findings.tell((*at, key, i), "out-of-range", message)
        ends[:, k] = given
    return ends


def _followed(tree: UrdfTree, joint: UrdfJoint) -> float:
    """How far a joint and those that follow it travel, in its own travel."""
    others = (other.mimic for other in tree.joints.values())
    return 1.0 + sum(abs(mimic[1]) for mimic in others if mimic is not None and mimic[0] == joint.name)
