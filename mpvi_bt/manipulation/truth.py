"""What the privileged expert may ask of the simulator: true poses, shapes and what the hands hold."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Protocol

from mpvi_bt.goals.state import WorldState
from mpvi_bt.perception.knowledge import KnowledgeBase
from mpvi_bt.robot.protocol import Side
from mpvi_bt.robot.solids import Array, Solid


class Bar(Protocol):
    """A bar that a hand can close around, in the world frame [m]; `mpvi_bt.sim.description.Handle` is one."""

    @property
    def center(self) -> Array:
        """(3,) middle of the bar."""
        ...

    @property
    def axis(self) -> Array:
        """(3,) unit vector along it."""
        ...

    @property
    def outward(self) -> Array:
        """(3,) unit vector to its free side."""
        ...


class Truth(WorldState, Protocol):
    """Simulator truth."""

    def knowledge(self) -> KnowledgeBase:
        """Where everything is now, what is carried or put away told apart."""
        ...

    def pose(self, name: str) -> Array:
        """T_world_thing (4, 4)."""
        ...

    def handles(self, name: str) -> Sequence[Bar]:
        """Bars to take hold of, in the world."""
        ...

    def holding(self, side: Side) -> str | None:
        """The movable thing that the fingers of one hand hold between them."""
        ...

    def within(self, name: str) -> Sequence[str]:
        """The movable things that lie in a thing's container volumes."""
        ...

    def obstacles(self, xy: Array, radius_m: float, without: Collection[str] = ()) -> list[Solid]:
        """Solids in the world of everything but the robot that come within `radius_m` of a place on the floor (2,)."""
        ...
