"""The handoffs that monitors watched in the episodes of a folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mpvi_bt.executive.monitors.calibration import Run
from mpvi_bt.executive.monitors.signals import SIGNALS
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.robot.default_robot import DEFAULT_ROBOT
from mpvi_bt.runs.choices.backends import name_of
from mpvi_bt.runs.episode.result import read_result

_COLUMNS = len(SIGNALS)


@dataclass(frozen=True)
class Watched:
    """One handoff.

    Attributes:
        run: Its skill and samples.
        ended: "success", "failure" or "interrupted".
        reason: Of a failure.
        faults: The policy was given some in that episode.
        task, instance: Of the episode.
    """

    run: Run
    ended: str
    reason: str
    faults: bool
    task: str
    instance: int


@dataclass(frozen=True)
class Handoffs:
    """All that were watched.

    Attributes:
        policy, robot: Whose they are.
        watched: In the order of the results' names, then of time.
    """

    policy: str
    robot: str
    watched: Sequence[Watched]

    @property
    def went_well(self) -> list[Run]:
        """Those that the checker found complete, of policies without faults."""
        return [w.run for w in self.watched if w.ended == "success" and not w.faults]


def read_handoffs(folder: Path) -> Handoffs:
    """The handoffs in the results below a folder.

    Raises:
        UserError: There is none, or they are of several policies or robots.
    """
    whose: dict[tuple[str, str], Path] = {}
    watched: list[Watched] = []
    results = 0
    for path in sorted(folder.rglob("*.json")):
        if path.name.endswith((".plan.json", ".saved.json")) or (result := read_result(path)) is None:
            continue
        results += 1
        if result.handoffs is None:
            continue
        policy, robot = name_of(str(result.config["policy"])), str(result.config.get("robot", DEFAULT_ROBOT))
        whose.setdefault((policy, robot), path)
        for handoff in result.handoffs:
            samples = np.array(handoff["samples"], float).reshape(-1, _COLUMNS)
            if len(samples):
                run = Run(str(handoff["skill"]), samples)
                ended, reason = str(handoff["ended"]), str(handoff["reason"])
                episode = result.task, result.instance_id
                watched.append(Watched(run, ended, reason, result.faults is not None, *episode))
    if not watched:
        raise UserError(f"{folder}: none of {results} results has handoffs; run with --unit monitored.")
    if len(whose) > 1:
        told = " and ".join(f"{policy} on {robot} ({path.name})" for (policy, robot), path in list(whose.items())[:2])
        raise UserError(f"{folder}: handoffs of {told}: thresholds are of one policy on one robot.")
    ((policy, robot),) = whose
    return Handoffs(policy, robot, watched)
