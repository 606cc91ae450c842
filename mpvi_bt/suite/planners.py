"""Makes the planner that a run chooses, and gathers what it is told of the place and the robot."""

from __future__ import annotations

from mpvi_bt.plan.context import Grounding
from mpvi_bt.robot.protocol import SIDES
from mpvi_bt.sim.catalogue import load_catalogue
from mpvi_bt.sim.house import load_house
from mpvi_bt.suite.tasks import Task


def ground(house: str, task: Task | None = None) -> Grounding:
    """What a plan can name in a house, and with the things of a task: what the knowledge base and detectors know.

    Args:
        house: Name or file.
        task: Whose things are there; None: they are not known.

    Raises:
        UserError: There is no such house.
        FileProblems: Everything that is wrong with its file.
    """
    place, catalogue = load_house(house), load_catalogue()
    fixtures = place.fixtures.values()
    names = {room.name: room.phrases for room in place.rooms.values()}
    names |= {f.name: (f.name, *f.entry.phrases) for f in fixtures}
    if task is not None:
        names |= {synset: catalogue.entries[name].phrases for synset, name in task.bindings.items()}
    return Grounding(
        rooms={room: tuple(f.entry.phrases[0] for f in fixtures if f.room == room) for room in place.rooms},
        names=names,
        things=task is not None,
        hands=SIDES,
    )
