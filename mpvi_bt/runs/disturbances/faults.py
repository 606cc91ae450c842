"""Faults of a policy, as an option gives them: "freeze:p=0.01, jitter:0.02, drift, late:400ms, wrong_object"."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from mpvi_bt.ground.errors import UnknownName, UserError, shown
from mpvi_bt.runs.disturbances.latency import LONGEST_S


@dataclass(frozen=True)
class FaultKind:
    """A kind of fault.

    Attributes:
        key: What its number is called; "" where it stands alone.
        usual: The number where none is given. Our choice: what makes about half of the expert's grasps fail.
        most: The largest that means anything.
        about: One line.
    """

    key: str
    usual: float
    most: float
    about: str


KINDS: Mapping[str, FaultKind] = {
    "freeze": FaultKind("p", 0.005, 1.0, "at each step with probability p it stops for good, until the next handoff"),
    "jitter": FaultKind("", 0.02, math.pi, "each arm joint's target is off by so much [rad, standard deviation]"),
    "drift": FaultKind(
        "", 0.02, math.pi, "the arm joints' targets move away by so much a second [rad/s, root mean square]"
    ),
    "late": FaultKind("", 0.4, LONGEST_S, "each chunk comes so late [s], and the robot holds until then"),
    "wrong_object": FaultKind("p", 0.5, 1.0, "at a handoff with probability p it takes another thing of the task"),
}
_MILLISECONDS = re.compile(r"(\S+)\s*ms")
_SECONDS = re.compile(r"(\S+)\s*s")
_EXAMPLE = "freeze:p=0.01, jitter:0.02, drift, late:400ms, wrong_object"


def read_faults(given: str) -> dict[str, float]:
    """Kind to number of each fault of an option such as "freeze:p=0.01, jitter:0.02, drift, late:400ms".

    Raises:
        UnknownName: There is no such fault.
        UserError: It is not written so, a number is out of range, or a fault is given twice.
    """
    found: dict[str, float] = {}
    for part in given.split(","):
        name, colon, text = (side.strip() for side in part.partition(":"))
        if name not in KINDS:
            raise UnknownName("fault", name, KINDS, "--policy-faults")
        if name in found:
            raise UserError(f"--policy-faults: {name} is given twice.")
        found[name] = _number(name, KINDS[name], text) if colon else KINDS[name].usual
    return found


def _number(name: str, kind: FaultKind, text: str) -> float:
    key, equals, value = text.rpartition("=")
    if (key.strip() if equals else "") not in ("", kind.key):
        wanted = f"{name}:{kind.key}={kind.usual:g}" if kind.key else f"{name}:{kind.usual:g}"
        raise UserError(f"--policy-faults: {name} is written {wanted}, not {shown(f'{name}:{text}')}.")
    scale = 1.0
    if name == "late" and (said := _MILLISECONDS.fullmatch(value.strip())):
        value, scale = said[1], 1e-3
    elif name == "late" and (said := _SECONDS.fullmatch(value.strip())):
        value = said[1]
    try:
        number = float(value) * scale
    except ValueError:
        raise UserError(f"--policy-faults: {name}:{shown(text)} is no number, such as {_EXAMPLE}.") from None
    if not 0.0 <= number <= kind.most:
        raise UserError(f"--policy-faults: {name} is 0 to {kind.most:g}, not {text}.")
    return number
