"""What predicates, and changes of states, ask of a world. `sim` implements it; tests make states by hand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

from mpvi_bt.ground.geometry.solids import Array, Solid, bounds

if TYPE_CHECKING:
    from mpvi_bt.house.states.temperature import Heat, Thermal


class WorldState(Protocol):
    """The physical state of named things (objects and fixtures), in the world frame, meters.

    Names are those of the scene: movable objects carry their BDDL name ("ashcan.n.01_1"), fixtures the house's name
    ("countertop_1"), floors "floor_<room>"; the episode binds BDDL names to them.
    """

    def exists(self, name: str) -> bool:
        """Whether the thing is in the world (sliced or consumed things are not)."""
        ...

    def solids(self, name: str) -> Sequence[Solid]:
        """The thing's collision solids, posed in the world."""
        ...

    def volumes(self, name: str) -> Sequence[Solid]:
        """The thing's container volumes (boxes or cylinders), posed in the world; empty if it holds nothing."""
        ...

    def touching(self, name: str, other: str) -> bool:
        """Whether physics reports a contact between the two now."""
        ...

    def joint_fractions(self, name: str) -> Sequence[float]:
        """Position of each of the thing's joints, 0 closed ... 1 fully open."""
        ...

    def toggled_on(self, name: str) -> bool:
        """Whether the thing's switch is on."""
        ...

    def covered(self, name: str, kind: str) -> bool:
        """Whether there are marks of a kind on the thing, such as "dust.n.01"."""
        ...

    def grains(self, kind: str) -> Sequence[str]:
        """Names of the grains of a substance that there are, such as "diced__beet.n.01"; each is a thing, too."""
        ...

    def attached(self, name: str, other: str) -> bool:
        """Whether the thing is mounted on the other."""
        ...

    def heat(self, name: str) -> tuple[Heat, Thermal]:
        """How warm the thing is, and what heat does to it."""
        ...


def aabb(state: WorldState, name: str) -> Array:
    """(2, 3) lowest and highest corner of the thing's axis-aligned bounding box."""
    return bounds(state.solids(name))
