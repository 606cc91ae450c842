"""The latency that a config gives policy, checker and planner."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from mpvi_bt.ground.protocols import Checker, Judgement
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.disturbances.latency import read_latencies


def draws_seed(config: EpisodeConfig) -> int:
    """Seed of an episode's latencies and faults: of its task and instance too, so that episodes differ in them."""
    return zlib.crc32(config.name.encode())


def latency_of(config: EpisodeConfig, part: str, answers: int = 0) -> Callable[[int], float]:
    """From the number of an answer to how long it takes, in simulated time [s]; 0 where the config says nothing.

    Args:
        config: Of the episode.
        part: "policy", "checker" or "planner".
        answers: That the part gave before the first that is asked about.

    Raises:
        UserError: The config's latency is none.
    """
    latency = read_latencies(config.latency).get(part) if config.latency is not None else None
    if latency is None:
        return lambda answer: 0.0
    seed = draws_seed(config)
    return lambda answer: latency.of(answers + answer, seed, part)


class LateChecker:
    """Another checker's answers, each later by a latency (implements `Checker`).

    Attributes:
        name, needs_image, remote: As of the other.
    """

    def __init__(self, checker: Checker, latency_s: Callable[[int], float]) -> None:
        """Answer as `checker` does, each answer `latency_s` of its number later [s]."""
        self._checker, self._latency_s = checker, latency_s
        self._answers = 0
        self.name, self.needs_image = checker.name, checker.needs_image
        self.remote: bool = getattr(checker, "remote", False)

    def save(self) -> dict[str, Any]:
        """Answers so far."""
        return {"answers": self._answers}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on from what `save` gave, with the next answer."""
        self._answers = int(saved["answers"])

    def check(self, criterion: str, image: CameraImage | None) -> Judgement:
        """The other's judgement."""
        late_s = self._latency_s(self._answers)
        self._answers += 1
        judged = self._checker.check(criterion, image)
        return replace(judged, latency_s=judged.latency_s + late_s)
