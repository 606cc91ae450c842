"""Latency of policy, checker and planner in simulated time, as an option gives it: "policy=0.4,checker=0.5..2"."""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mpvi_bt.ground.errors import UnknownName, UserError, shown
from mpvi_bt.ground.robot.protocol import CONTROL_HZ

PARTS = ("policy", "checker", "planner")
LONGEST_S = 600.0  # BEHAVIOR's limit of one question (challenge rules of 2026)
_EXAMPLE = "policy=0.4,checker=0.5..2,planner=@measured.json"
_SLACK = 1e-9  # so that 0.4 s are twelve steps, not thirteen


@dataclass(frozen=True)
class Latency:
    """How long each answer of one part takes, in simulated time.

    Attributes:
        least_s, most_s: Each answer's time is drawn evenly from between them [s].
        measured_s: Times that were measured; where there are any, they come in turn, over and over.
    """

    least_s: float = 0.0
    most_s: float = 0.0
    measured_s: tuple[float, ...] = ()

    def of(self, answer: int, seed: int, part: str) -> float:
        """How long an answer takes [s]. It follows from the arguments alone.

        Args:
            answer: Number of the answer in the episode, from 0.
            seed: Of the episode.
            part: Whose answer it is.
        """
        if self.measured_s:
            return self.measured_s[answer % len(self.measured_s)]
        if self.least_s == self.most_s:
            return self.least_s
        draws = np.random.default_rng([seed, zlib.crc32(part.encode()), answer])
        return float(draws.uniform(self.least_s, self.most_s))

    def __str__(self) -> str:
        """For a person."""
        if self.measured_s:
            return f"{len(self.measured_s)} measured times, {np.mean(self.measured_s):.3g} s on average"
        return f"{self.least_s:g} s" if self.least_s == self.most_s else f"{self.least_s:g} to {self.most_s:g} s"


def in_steps(seconds: float) -> int:
    """Control steps until an answer arrives; a step already begun is waited for."""
    return math.ceil(seconds * CONTROL_HZ - _SLACK)


def read_latencies(given: str) -> dict[str, Latency]:
    """Part to latency, of an option such as "policy=0.4,checker=0.5..2,planner=@measured.json".

    A value is a number of seconds, two for a draw between them, or "@" and a JSON file: a list of seconds, or an
    object with such a list under the part's name.

    Raises:
        UnknownName: There is no such part.
        UserError: It is not written so, a time is out of range, a part is named twice, or a file does not hold times.
    """
    found: dict[str, Latency] = {}
    for part in given.split(","):
        name, equals, text = (side.strip() for side in part.partition("="))
        if not equals:
            raise UserError(f"--latency: {shown(part)} is not PART=SECONDS, such as {_EXAMPLE}.")
        if name not in PARTS:
            raise UnknownName("part", name, PARTS, "--latency")
        if name in found:
            raise UserError(f"--latency: {name} is given twice.")
        found[name] = _measured(name, text[1:]) if text.startswith("@") else _range(name, text)
    return found


def _range(name: str, text: str) -> Latency:
    least, dots, most = text.partition("..")
    low, high = _seconds(name, least), _seconds(name, most if dots else least)
    if high < low:
        raise UserError(f"--latency: {name}={text}: the second time is the longer one.")
    return Latency(low, high)


def _seconds(name: str, text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        raise UserError(f"--latency: {name}={shown(text)} is no number of seconds, such as {_EXAMPLE}.") from None
    return _checked(name, seconds)


def _checked(name: str, seconds: float, file: str = "") -> float:
    if not 0.0 <= seconds <= LONGEST_S:
        where = f"{file}: " if file else ""
        raise UserError(f"--latency: {where}{name} takes 0 to {LONGEST_S:g} s, not {shown(seconds)}.")
    return float(seconds)


def _measured(name: str, file: str) -> Latency:
    try:
        data = json.loads(Path(file).read_bytes())
    except OSError as error:
        raise UserError(f"--latency: {name}=@{file}: {(error.strerror or str(error)).lower()}.") from None
    except (ValueError, RecursionError):
        raise UserError(f"--latency: {file} is no JSON.") from None
    times = data.get(name) if isinstance(data, Mapping) else data
    if not isinstance(times, list) or not times or any(type(time) not in (int, float) for time in times):
        raise UserError(f'--latency: {file} has no list of seconds for {name}, such as {{"{name}": [0.31, 0.29]}}.')
    return Latency(measured_s=tuple(_checked(name, time, file) for time in times))
