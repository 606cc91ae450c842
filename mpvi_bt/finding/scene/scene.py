"""World knowledge of a scripted skill: the truth in the simulator, or the camera pictures of a robot."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.executive.plan.knowledge import KnowledgeBase
from mpvi_bt.finding.scene.mount_pose import Mount
from mpvi_bt.finding.shapes.moving_parts import Bar, Door
from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.ground.robot.collision import Obstacles
from mpvi_bt.ground.robot.protocol import CameraImage, Proprioception, Side


class Scene(Protocol):
    """What is known of things, by name, in the world frame [m].

    Attributes:
        needs_looks: Whether a skill must look before it works: the scene knows only what pictures have shown.
        pose_error_m: How far off the pose of a thing may be [m]; 0: poses are exact.
    """

    needs_looks: bool
    pose_error_m: float

    def knowledge(self) -> KnowledgeBase:
        """Known things and their names; things carried or put away are marked."""
        ...

    def pose(self, name: str) -> Array:
        """T_world_thing (4, 4); where only a shape is known, a frame in its middle, z up."""
        ...

    def solids(self, name: str) -> Sequence[Solid]:
        """The thing's solids; where it is only seen, of furniture its faces."""
        ...

    def body(self, name: str) -> Sequence[Solid]:
        """The whole known thing, from its foot to its top. Things set down beside it keep clear of it."""
        ...

    def volumes(self, name: str) -> Sequence[Solid]:
        """Its container volumes; empty if it holds nothing."""
        ...

    def handles(self, name: str) -> Sequence[Bar]:
        """Bars to carry it by."""
        ...

    def doors(self, name: str) -> Sequence[Door]:
        """Its parts that open."""
        ...

    def switches(self, name: str) -> Sequence[Array]:
        """T_world_switch (4, 4) of each switch, its z pointing out of the thing."""
        ...

    def mounts(self, name: str) -> Sequence[Mount]:
        """Its mounts, as they are in the world; none where they cannot be told."""
        ...

    def is_on(self, name: str) -> bool | None:
        """Whether a thing with a switch is turned on; None if unknown."""
        ...

    def holding(self, side: Side) -> str | None:
        """The movable thing that the fingers of one hand hold between them."""
        ...

    def between(self) -> str | None:
        """The movable thing that both hands hold between them, pressed from its sides."""
        ...

    def within(self, name: str) -> Sequence[str]:
        """The movable things that lie in a thing's container volumes."""
        ...

    def laden(self, name: str) -> bool:
        """Whether a payload contains something loose: it would fall out of a tipped payload."""
        ...

    def obstacles(
        self, xy: Array, radius_m: float, without: Collection[str] = (), beside: str | None = None
    ) -> Obstacles:
        """Everything but the robot that comes within `radius_m` of a place on the floor (2,), less `without`.

        Less all the `body` of the thing `beside` which something is to be set down, too.
        """
        ...

    def spots(self, surface: str, radius_m: float, height_m: float, near: Array) -> Sequence[Array]:
        """Places (3,) on a thing's upper faces with room for an upright cylinder, the nearest to `near` (2,) first."""
        ...

    def see(self, images: Mapping[str, CameraImage], felt: Proprioception) -> None:
        """Take in pictures, by camera, and what the robot felt when they were taken."""
        ...

    def covered(self, places: Array, radius_m: float) -> NDArray[np.bool_]:
        """(n,) bool: whether discs about places (n, 2) of the floor meet what was put there, and may look like it."""
        ...

    def others(self, name: str) -> Sequence[str]:
        """Names of further contents of a vessel, not asked for by any phrase. `solids` accepts these names."""
        ...

    def trusting(self, remembering: bool = False) -> AbstractContextManager[None]:
        """While this lasts, only surfaces seen from here are obstacles, and the hidden space behind them is free.

        With `remembering` surfaces that were seen from the last places count, too.
        """
        ...
