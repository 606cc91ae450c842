"""The backends that a run can choose, by kind and name. Light, so that the command line can list them at once.

A name stands for a class that only its own module imports. `privileged` backends read simulator truth: every result
names those that a run used.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mpvi_bt.errors import UnknownName


@dataclass(frozen=True)
class Backend:
    """One choice.

    Attributes:
        about: One line for a person.
        privileged: Whether it reads simulator truth.
    """

    about: str
    privileged: bool = False


BACKENDS: Mapping[str, Mapping[str, Backend]] = {
    "planner": {"recorded": Backend("the plan on file for the task")},
    "map": {"prior": Backend("occupancy and rooms, derived from the house before the episode")},
    "detector": {"oracle": Backend("where every object is, from the simulator", privileged=True)},
    "policy": {"expert": Backend("scripted grasps and placements on true poses: the upper bound", privileged=True)},
    "checker": {
        "visual": Backend("judges a criterion by what one camera image shows"),
        "oracle": Backend("judges a criterion by the simulator's state", privileged=True),
    },
}


def choose(kind: str, name: str) -> Backend:
    """The backend of a name.

    Raises:
        UnknownName: There is none of that name.
    """
    known = BACKENDS[kind]
    if name not in known:
        raise UnknownName(kind, name, known)
    return known[name]


def privileged(chosen: Mapping[str, str]) -> list[str]:
    """Those of the chosen backends (kind to name) that read simulator truth, as "kind:name", sorted."""
    return sorted(f"{kind}:{name}" for kind, name in chosen.items() if choose(kind, name).privileged)
