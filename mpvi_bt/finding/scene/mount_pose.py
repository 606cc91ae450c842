"""Mounts of things, such as a nail in a wall and the hanger of a picture."""

from __future__ import annotations

from dataclasses import dataclass

from mpvi_bt.ground.geometry.solids import Array


@dataclass(frozen=True, eq=False)
class Mount:
    """A place of a thing that fits one of another.

    Attributes:
        kind: Of the pair, such as "wall_nail".
        male: The male one is the child's, the female one the parent's.
        pose: (4, 4) in the world.
        free: Whether nothing is mounted there.
    """

    kind: str
    male: bool
    pose: Array
    free: bool = True
