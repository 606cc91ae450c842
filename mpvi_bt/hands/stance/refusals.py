"""What the candidates of a search for a stance were refused for: a search that finds nothing says why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.collision import Obstacles


@dataclass(frozen=True)
class Telling:
    """How much is reported about rejected candidates.

    Our choice: what a person reads in one line.
    """

    asked: int = 4  # refusals of one kind that are checked for the obstacle
    named: int = 2  # obstacles that are named per kind


_TELLING = Telling()

Place = Callable[[], Array]  # (4,) x, y, z and radius [m] in the world of a sphere of the robot that met something


class Refusals:
    """Candidates of a search, counted by what each was refused for."""

    def __init__(self) -> None:
        """None so far."""
        self._counts: Counter[str] = Counter()
        self._places: dict[str, list[Place]] = {}

    def add(self, kind: str, *places: Place, count: int | None = None) -> None:
        """Count candidates, and keep where the first of them met something; that is computed only if it is told.

        Args:
            kind: A few words, such as "arm in the way".
            places: Where, of each.
            count: How many; as many as there are places if it is not given, or one.
        """
        self._counts[kind] += max(len(places), 1) if count is None else count
        kept = self._places.setdefault(kind, [])
        kept += places[: _TELLING.asked - len(kept)]

    def clear(self) -> None:
        """Forget all."""
        self._counts.clear()
        self._places.clear()

    def told(self, named: Callable[[Array], str | None]) -> str:
        """In a line, such as "18 candidates: 12 no room for the base (sofa), 6 no way there"; empty if there were none.

        Args:
            named: What a sphere (4,) x, y, z, radius [m] in the world meets, by name.
        """
        parts = []
        for kind, n in self._counts.most_common():
            if not n:
                break
            names = Counter(name for place in self._places[kind] if (name := named(place())) is not None)
            met = ", ".join(name for name, _ in names.most_common(_TELLING.named))
            parts.append(f"{n} {kind}" + (f" ({met})" if met else ""))
        return f"{self._counts.total()} candidates: {', '.join(parts)}" if parts else ""


def deepest(around: Obstacles, centers: Array, radii: Array, T: Array) -> Array:
    """(4,) in the world the center and radius of that sphere which is deepest in what is around.

    Args:
        around: In some frame.
        centers: (n, 3) in that frame.
        radii: (n,) [m].
        T: (4, 4) from that frame to the world.
    """
    k = int(np.argmin(around.distance(centers) - radii))
    return np.append(matmul(T[:3, :3], centers[k]) + T[:3, 3], radii[k])
