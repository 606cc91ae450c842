"""An action of the classical planner: a skill done to things."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from mpvi_bt.runs.symbolic.told_facts import Atom

DRIVE_COST, WAIT_COST, HAND_COST = 8, 1, 2  # our choice: a drive takes as long as four motions of a hand
FLOOR_COST = 4  # our choice: what is set down on a floor is in the way, and hands reach it less well
ASIDE_COST = DRIVE_COST  # our choice: what is put aside is looked for and driven to again before it is picked up
# Our choice: to work on what hangs in a hand is worse than two drives more, of who sets it down and comes back. In the
# house such plans failed.
HANGING_COST = 3 * DRIVE_COST
DOOR_COST = 7  # our choice: a payload in the other hand is easily lost while one hand moves a door
# Our choice: what lies loose on a thing that is moved may fall, fire burns, and with both arms around a thing the robot
# finds no way past what lies on the floor.
ADVERSE_COST = 2 * DRIVE_COST
HANDS = ("right", "left")


@dataclass(frozen=True)
class GroundedAction:
    """A skill done to things.

    Attributes:
        skill: Such as "pick"; "go_to" is a drive; "" is what a machine does by itself.
        args: The things, in the order of a plan's words.
        hand: That does it; "" if either may, or both.
        needs, forbids: Atoms that have to be so, and that must not be so.
        adds, drops: Atoms that are so afterwards, and that are not any more.
        cost: More is worse.
        words: The skill's slots, filled.
    """

    skill: str
    args: tuple[str, ...]
    hand: str = ""
    needs: frozenset[Atom] = frozenset()
    forbids: frozenset[Atom] = frozenset()
    adds: frozenset[Atom] = frozenset()
    drops: frozenset[Atom] = frozenset()
    cost: int = HAND_COST
    words: Mapping[str, str] = field(default_factory=dict, compare=False)
