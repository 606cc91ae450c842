"""Results of suites that nobody ran, for the tests of reports: any number of methods, tasks and instances."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.result import Result
from mpvi_bt.runs.report.runs import Runs
from tests.fake_episodes import fake_result

TASKS = ("picking_up_trash", "hiding_Easter_eggs", "putting_shoes_on_rack", "tidying_bedroom")
REASONS = ("no_path", "not_found", "grasp_failed", "timeout")


def synthetic_result(config: EpisodeConfig, share: float, literals: int = 4, corners: int = 30) -> Result:
    """A result whose literals each hold with a probability; the same for the same arguments."""
    rng = np.random.default_rng([zlib.crc32(config.name.encode()), config.instance, round(share * 1000)])
    held = rng.random(literals) < share
    q = float(held.mean())
    way = np.cumsum(rng.normal(0, 0.5, (corners, 2)), 0).clip(-3, 3).round(2).tolist()
    data = fake_result(config, steps=int(rng.integers(600, 6000)))
    data |= {
        "success": bool(held.all()),
        "q_score": {"final": q},
        "goal_fraction": q,
        "conditions_met": q,
        "goal": [
            {"condition": f"{'inside' if i % 2 else 'ontop'}(thing.n.01_{i}, bin.n.01_1)", "satisfied": bool(ok)}
            for i, ok in enumerate(held)
        ],
        "ended": "success" if held.all() else str(rng.choice(["failure", "time_limit"])),
        "failures": [
            {"node": f"{config.task_name}/{i} segment", "reason": str(rng.choice(REASONS)), "feedback": "it did not",
             "time_s": 10.0 * i}
            for i, ok in enumerate(held) if not ok
        ],
        "way": {"base": way, "things": {f"thing.n.01_{i}": [way[i], way[-i - 1]] for i in range(literals)}},
        "wall": {"total_s": 20.0, "setup_s": 2.0,
                 "loop": {"stepping": 9.0, "rendering": 3.0, "navigation": 1.0, "policy": 2.0, "ticking": 1.0}},
    }  # fmt: skip
    return Result.model_validate(data)


def synthetic_runs(
    method: str,
    share: float,
    tasks: Sequence[str] = TASKS,
    instances: int = 3,
    finished: float = 1.0,
    folder: Path | None = None,
) -> Runs:
    """The runs of a method whose literals each hold with a probability, the first `finished` of them done."""
    episodes = [EpisodeConfig(task, instance) for task in tasks for instance in range(instances)]
    done = episodes[: round(finished * len(episodes))]
    return Runs(method, episodes, {c: synthetic_result(c, share) for c in done}, folder=folder)
