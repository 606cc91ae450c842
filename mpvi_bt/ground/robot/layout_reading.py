"""The layout of a robot's actions, as its file says or as its joints follow each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mpvi_bt.ground.marked_yaml import Location
from mpvi_bt.ground.robot.action_layout import ActionLayout
from mpvi_bt.ground.robot.joint_group import JointGroup
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Side
from mpvi_bt.ground.robot.robot_file import RobotFile
from mpvi_bt.ground.robot.robot_findings import RobotFindings

_BASE_NUMBERS = ("base_vx", "base_vy", "base_yaw_rate")


def read_layout(
    findings: RobotFindings, told: RobotFile, torso: JointGroup, arms: Mapping[Side, JointGroup]
) -> tuple[tuple[str | None, ...], ActionLayout]:
    """Names of the torso's numbers, None of unused ones, and the layout of actions."""
    base = [n for n in _BASE_NUMBERS if n != "base_vy" or told.base.kind == "holonomic"]
    names = [*base, *torso.joints]
    for side, arm in arms.items():
        names += [*arm.joints, f"gripper_{side}"]
    at: Location = ("actions", "numbers")
    if (given := told.actions.numbers) is not None:
        known = {*names, *_BASE_NUMBERS}
        for i, n in enumerate(given):
            if n in given[:i]:
                findings.tell((*at, i), "duplicate", f"a second number {n!r}")
            elif n not in known and not n.startswith("unused"):
                findings.unknown((*at, i), "number", n, known, whose="")
        if left := [n for n in names if n not in given]:
            findings.tell(at, "missing-key", f"no number for {', '.join(left)}")
        findings.stop_if_wrong()
        names = given
    rate_hz = told.actions.rate_hz
    if not (CONTROL_HZ / rate_hz).is_integer():
        message = f"{rate_hz:g} does not divide {CONTROL_HZ}, the control steps a second, as 10 or 15 do"
        findings.tell(("actions", "rate_hz"), "out-of-range", message)
    span = _span(findings, names, torso.joints, at, "the torso")
    order = tuple(n if n in torso.joints else None for n in names[span])
    if tuple(n for n in order if n is not None) != torso.joints:
        findings.tell(at, "out-of-range", "the torso's joints stand in another order than in `torso.joints`")
    layout = ActionLayout(
        names=tuple(names),
        base=(_index(names, "base_vx"), _index(names, "base_vy"), _index(names, "base_yaw_rate")),
        torso=span,
        arm={side: _span(findings, names, arm.joints, at, f"the {side} arm") for side, arm in arms.items()},
        gripper={side: names.index(f"gripper_{side}") for side in arms},
        kind=told.actions.kind,
        rate_hz=rate_hz,
    )
    for side, arm in arms.items():
        if tuple(names[layout.arm[side]]) != arm.joints:
            findings.tell(at, "out-of-range", f"joints of the {side} arm have to stand together, as in `arms.{side}`")
    return order, layout


def _span(findings: RobotFindings, names: Sequence[str], joints: Sequence[str], at: Location, whose: str) -> slice:
    """Where joints stand among numbers; what is between them has to be unused."""
    where = [names.index(n) for n in joints]
    if not where:
        return slice(3, 3)
    span = slice(min(where), max(where) + 1)
    if any(n not in joints and not n.startswith("unused") for n in names[span]):
        findings.tell(at, "out-of-range", f"joints of {whose} have to stand together")
    return span


def _index(names: Sequence[str], name: str) -> int | None:
    return names.index(name) if name in names else None
