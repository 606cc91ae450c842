"""Thresholds of the signals over time, by skill, from handoffs that went well: split-conformal prediction."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from mpvi_bt.executive.monitors.signals import SAMPLE_S, SIGNALS
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.marked_yaml import Record, load_marked, validate_data
from mpvi_bt.ground.writing import write_whole

ALPHA = 0.1  # share of runs that may pass a signal's threshold though they go well. Our choice
_FEWEST = 3  # runs that a time's mean and spread stand on; later times keep the last ones. Our choice
# Below these a signal says nothing: noise of a signal that hardly ever moved must not become an alarm. Our choice.
_LEAST_SPREAD = {"reversals": 0.05, "disagreement": 0.01, "stall": 0.5, "grip": 0.5}

Signal = Literal["reversals", "disagreement", "stall", "grip"]


class SkillThresholds(Record):
    """Of one skill.

    Attributes:
        runs: Handoffs that the thresholds stand on.
        thresholds: Signal to its threshold at each sample; the last one holds from then on.
    """

    runs: Annotated[int, Field(ge=1)]
    thresholds: dict[Signal, list[float]]


class Calibration(Record):
    """Thresholds for a policy on a robot.

    Attributes:
        calibration: Version of this layout.
        policy, robot: Whose handoffs they stand on.
        alpha: Share of handoffs that go well of which each signal may pass its threshold.
        sample_s: Time between two samples [s].
        skills: By name.
    """

    calibration: Literal[1] = 1
    policy: str
    robot: str
    alpha: Annotated[float, Field(gt=0, lt=1)]
    sample_s: Annotated[float, Field(gt=0)] = SAMPLE_S
    skills: dict[str, SkillThresholds]

    def alarms(self, skill: str, sample: int, values: Sequence[float]) -> list[tuple[str, float, float]]:
        """The signals that are past their thresholds: name, value, threshold.

        Args:
            skill: That the policy is at.
            sample: Number of the sample, from 0 at the handoff.
            values: As of `SIGNALS`.
        """
        if (known := self.skills.get(skill)) is None:
            return []
        found = []
        for name, value in zip(SIGNALS, values, strict=True):
            levels = known.thresholds.get(name)  # type: ignore[call-overload]
            if levels and value > (level := levels[min(sample, len(levels) - 1)]):
                found.append((name, value, level))
        return found

    def write(self, path: Path) -> None:
        """Write it as JSON, rounded; the same calibration gives the same bytes."""
        write_whole(path, json.dumps(self.model_dump(mode="json"), indent=1) + "\n")


@dataclass(frozen=True)
class Run:
    """The samples of one handoff that went well.

    Attributes:
        skill: That the policy was at.
        samples: (n, 4) the signals every `SAMPLE_S`, as of `SIGNALS`.
    """

    skill: str
    samples: Array


def fewest_runs(alpha: float) -> int:
    """Handoffs of a skill that a coverage of 1 - alpha needs: half of them give mean and spread, half the quantile."""
    return 2 * math.ceil(1.0 / alpha - 1.0)


def calibrate(runs: Iterable[Run], policy: str, robot: str, alpha: float = ALPHA) -> tuple[Calibration, dict[str, int]]:
    """Thresholds for every skill with enough runs; and how many there are of each other skill.

    Of a skill's runs every other one, in the order given, yields mean and spread of each signal at each time; of the
    rest each yields the most that it is above the mean, in spreads, at any time. Their quantile at rank
    ceil((n + 1) (1 - alpha)) of n makes the threshold: mean + quantile x spread (Lei et al., "Distribution-Free
    Predictive Inference for Regression", JASA 2018; over time as FIPER, arXiv 2510.09459). A run that goes well and is
    exchangeable with these passes a signal's threshold at any time with probability alpha at most.

    Raises:
        UserError: alpha is no share, or no skill has enough runs.
    """
    if not 0.0 < alpha < 1.0:
        raise UserError(f"a share of false alarms is above 0 and below 1, not {alpha:g}.")
    by_skill: dict[str, list[Array]] = {}
    for run in runs:
        by_skill.setdefault(run.skill, []).append(run.samples)
    needed = fewest_runs(alpha)
    enough = {skill: found for skill, found in sorted(by_skill.items()) if len(found) >= needed}
    short = {skill: len(found) for skill, found in sorted(by_skill.items()) if len(found) < needed}
    if not enough:
        told = ", ".join(f"{skill} {count}" for skill, count in short.items()) or "none at all"
        raise UserError(
            f"a share of {alpha:g} false alarms needs {needed} handoffs of a skill that went well; there are: {told}."
        )
    skills = {skill: SkillThresholds(runs=len(s), thresholds=_thresholds(s, alpha)) for skill, s in enough.items()}
    return Calibration(policy=policy, robot=robot, alpha=alpha, skills=skills), short


def _thresholds(runs: Sequence[Array], alpha: float) -> dict[Signal, list[float]]:
    fitted, held_out = runs[::2], runs[1::2]
    found: dict[Signal, list[float]] = {}
    for i, name in enumerate(SIGNALS):
        mean, spread = _band([run[:, i] for run in fitted], _LEAST_SPREAD[name])
        over = sorted(_most_above(run[:, i], mean, spread) for run in held_out)
        rank = math.ceil((len(over) + 1) * (1.0 - alpha) - 1e-9)
        level = mean + max(over[rank - 1], 0.0) * spread
        found[name] = [round(float(v), 6) for v in level]  # type: ignore[index]
    return found


def _band(runs: Sequence[Array], least: float) -> tuple[Array, Array]:
    """Mean and spread at each time that enough runs reached."""
    reached = sorted((len(run) for run in runs), reverse=True)[min(_FEWEST, len(runs)) - 1]
    columns = [np.array([run[t] for run in runs if len(run) > t]) for t in range(max(reached, 1))]
    return np.array([c.mean() for c in columns]), np.array([max(float(c.std()), least) for c in columns])


def _most_above(run: Array, mean: Array, spread: Array) -> float:
    at = np.minimum(np.arange(len(run)), len(mean) - 1)
    return float(((run - mean[at]) / spread[at]).max(initial=-math.inf))


def load_calibration(path: str | Path, policy: str, robot: str) -> Calibration:
    """The calibration in a file.

    Raises:
        UserError: There is no such file, or it is of another policy or robot.
        FileProblems: Everything that is wrong with it.
    """
    found = validate_data(*load_marked(path), Calibration)
    for what, due, has in (("policy", policy, found.policy), ("robot", robot, found.robot)):
        if due != has:
            raise UserError(f"{path} was calibrated with the {what} {has!r}, and this run has {due!r}.")
    return found
