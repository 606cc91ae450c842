"""What a hand holds."""

from __future__ import annotations

from dataclasses import dataclass

from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.ground.robot.collision import Load
from mpvi_bt.ground.robot.protocol import Side


@dataclass(frozen=True, eq=False)
class Held:
    """What a hand holds.

    Attributes:
        name: The thing.
        side: The hand.
        T_tcp_thing: (4, 4).
        solids: Of it and what lies in it, in the tcp frame.
        load: The same, for collision checks.
        laden: Whether something lies in it or on it, which falls out if it is tipped.
    """

    name: str
    side: Side
    T_tcp_thing: Array
    solids: tuple[Solid, ...]
    load: Load
    laden: bool = False
