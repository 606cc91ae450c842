"""The movable things in the world. Future things wait far below the floor; used-up things go there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import sapien

from mpvi_bt.ground.geometry.solids import Array, pose
from mpvi_bt.house.sim.builder import Thing
from mpvi_bt.house.states.in_world import Motion

_DEPTH_M, _APART_M = 30.0, 0.5  # where they wait: nothing falls so far, and none touches another


class Presence:
    """What is there.

    Attributes:
        there: Movable things by name; those that look at it see at once what comes and goes.
    """

    def __init__(self, there: dict[str, Thing], everything: dict[str, Thing], later: Mapping[str, str]) -> None:
        """All of `later` begins to wait.

        Args:
            there: Movable things, all of `later` among them.
            everything: The same, and fixtures.
            later: Names of what may come to be, in the order in which they do, each with its kind.
        """
        self.there, self._everything = there, everything
        self._movable = dict(there)
        self._later = dict(later)
        for name in later:
            self._hide(name)

    @property
    def changes(self) -> bool:
        """Whether anything may come to be."""
        return bool(self._later) or self.there.keys() != self._movable.keys()

    def waits(self, kind: str) -> bool:
        """Whether one of a kind may still come to be."""
        return kind in self._later.values()

    def appear(self, kind: str, T: Array, motion: Motion) -> str | None:
        """Have the next of a kind stand at `T` (4, 4) and move like what it comes from.

        Returns:
            Its name; None if all of them have come.
        """
        name = next((n for n, k in self._later.items() if k == kind), None)
        if name is not None:
            del self._later[name]
            self._show(name)
            self.there[name].place(T)
            place = self.there[name].motion()["pose"]
            self.there[name].set_motion({"pose": place, "v": list(motion["v"])})
        return name

    def vanish(self, name: str) -> None:
        """Take a thing out of the world for good."""
        self._hide(name)

    def save(self) -> dict[str, Any]:
        """As JSON values: present things and future things; empty if nothing ever comes or goes."""
        return {"there": list(self.there), "later": dict(self._later)} if self.changes else {}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Have the same things be there, in the same order."""
        if not saved:
            return
        self._later = dict(saved["later"])
        for name in list(self.there):
            self._hide(name)
        for name in saved["there"]:
            self._show(name)

    def _hide(self, name: str) -> None:
        thing = self.there.pop(name)
        del self._everything[name]
        thing.rigid_body.kinematic = True
        place = (_APART_M * list(self._movable).index(name), 0.0, -_DEPTH_M)
        thing.entity.set_pose(sapien.Pose(pose(place)))

    def _show(self, name: str) -> None:
        thing = self._movable[name]
        self.there[name] = self._everything[name] = thing
        thing.rigid_body.kinematic = False
