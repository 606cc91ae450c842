"""What searches may take: checks of base poses, counted."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from mpvi_bt.ground.geometry.solids import Array


@dataclass(eq=False)
class Effort:
    """What stance searches may still take, counted and not timed so that the same seed plans the same motions.

    Attributes:
        left: Base poses that may still be checked in full; what is played earns more.
        failed: Base poses (3,) that did not do, by what was searched for, since a search last found something: a retry
            goes on where the last try ended.
    """

    left: float = np.inf
    failed: dict[bytes, list[Array]] = field(default_factory=dict)

    @contextmanager
    def sparing(self, part: float) -> Iterator[None]:
        """What is searched for within this leaves a part (0 to 1) of what is left for what comes after it."""
        spared = part * max(self.left, 0.0) if np.isfinite(self.left) else 0.0
        self.left -= spared
        try:
            yield
        finally:
            self.left += spared
