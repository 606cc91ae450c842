"""A checker with errors: false yes and false no at given rates, and latency."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace

import numpy as np

from mpvi_bt.ground.protocols import Checker, Clock, Judgement
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.ground.words.sizes import Mistakes


@dataclass(frozen=True)
class CheckErrors(Mistakes):
    """How often a checker errs, and how long it takes; 0 switches each off.

    Attributes:
        fp: Probability that a no becomes a yes (a false positive, where the checker was right).
        fn: Probability that a yes becomes a no.
        latency: How long every answer takes [s], in simulated time.
    """

    MOST = {"fp": 1.0, "fn": 1.0, "latency": 600.0}
    EXAMPLE = "fp=0.05,fn=0.1,latency=1"

    fp: float = 0.0
    fn: float = 0.0
    latency: float = 0.0

    def __str__(self) -> str:
        """One line for a person."""
        took = f", each after {self.latency:g} s" if self.latency else ""
        return f"says yes to {self.fp:.1%} of what it sees undone and no to {self.fn:.1%} of what it sees done{took}"


class MistakenChecker:
    """Another checker's answers, some of them inverted (implements `Checker`).

    A draw follows from the seed, the criterion and the step, so the same run has the same errors, and every answer may
    be wrong, as a language model's may (Paper, Completion Checker: each query introduces an independent risk of
    hallucination).

    Attributes:
        name: The other's, with the errors' address.
        needs_image: As of the other.
        note: One line on the errors, to be printed.
    """

    def __init__(self, checker: Checker, errors: CheckErrors, clock: Clock, seed: int = 0) -> None:
        """Err so about what `checker` says, by draws from `seed`."""
        self._checker, self._errors, self._clock, self._seed = checker, errors, clock, seed
        self.name, self.needs_image = f"{checker.name}:{errors.address}", checker.needs_image
        self.note = f"checker {checker.name} {errors}"

    def check(self, criterion: str, image: CameraImage | None) -> Judgement:
        """The other's judgement, or its opposite."""
        judged, errors = self._checker.check(criterion, image), self._errors
        judged = replace(judged, latency_s=judged.latency_s + errors.latency)
        draws = np.random.default_rng([self._seed, zlib.crc32(criterion.encode()), self._clock.steps])
        if judged.fault or draws.random() >= (errors.fn if judged.complete else errors.fp):
            return judged
        return replace(judged, complete=not judged.complete, reason=f"by mistake; {judged.reason}")
