"""What the joints of a torso do to its posture, as a robot's file says or as axes and places tell."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.described import DescribedTrunk
from mpvi_bt.ground.robot.kinematic_chain import BaseFrame, KinematicChain
from mpvi_bt.ground.robot.robot_file import TorsoPart
from mpvi_bt.ground.robot.robot_findings import RobotFindings

_UPRIGHT = 0.7  # sine from which an axis counts as one of x, y and z


def read_trunk(
    findings: RobotFindings,
    part: TorsoPart,
    frame: BaseFrame,
    order: Sequence[str | None],
    limits: Array,
    chest: str,
    head: str,
) -> DescribedTrunk:
    """The trunk of a robot.

    Args:
        findings: Takes what does not fit.
        part: Of the file.
        frame: The base frame.
        order: Names of the torso's numbers; None of one that no joint follows.
        limits: (n, 2) of the joints.
        chest: The link that carries the arms.
        head: The link of the camera to search with.
    """
    chain = frame.chain(chest, np.eye(4), order)
    axes = {name: _axis(name, frame, order) for name in order if name is not None}
    guess = _guessed(axes, frame, chain, order, head)
    parts: list[int | None] = []
    signs = np.ones(4)
    for k, (key, along) in enumerate((("lift", 2), ("turn", 2), ("bend", 1), ("tilt", 1))):
        name = getattr(part, key) or guess.get(key)
        if name is not None and name not in axes:
            findings.unknown(("torso", key), "joint", name, list(axes), whose=" of the torso")
            name = None
        parts.append(None if name is None else order.index(name))
        if name is not None:
            signs[k] = math.copysign(1.0, axes[name][along])
    return DescribedTrunk(limits, tuple(parts), signs, chain)


def _axis(name: str, frame: BaseFrame, order: Sequence[str | None]) -> Array:
    """(3,) the axis of a joint in the base frame, all joints at 0."""
    joint = frame.tree.joints[name]
    R = frame.chain(joint.child, np.eye(4), order).pose(np.zeros(len(order)))[:3, :3]
    return matmul(R, np.array(joint.axis))


def _guessed(
    axes: dict[str, Array], frame: BaseFrame, chest: KinematicChain, order: Sequence[str | None], head: str
) -> dict[str, str]:
    """What joints of the torso do, by their axes: one that slides up lifts, about z turns, about y bends or tilts.

    Where several would do the same, none does: postures then leave them as they are.
    """
    carrying = {order[i] for i in chest.used}
    seeing = {joint.name for joint in frame.tree.path(head, frame.link) or ()}
    found: dict[str, list[str]] = {"lift": [], "turn": [], "bend": [], "tilt": []}
    for name, axis in axes.items():
        if frame.tree.joints[name].kind == "prismatic":
            if abs(axis[2]) > _UPRIGHT:
                found["lift"].append(name)
        elif abs(axis[2]) > _UPRIGHT and name in carrying:
            found["turn"].append(name)
        elif abs(axis[1]) > _UPRIGHT:
            if name in carrying:
                found["bend"].append(name)
            elif name in seeing:
                found["tilt"].append(name)
    return {key: names[0] for key, names in found.items() if len(names) == 1}
