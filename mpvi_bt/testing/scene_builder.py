"""Builds small worlds for tests: one room, its fixtures, things in it, and a robot that may hold some of them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from mpvi_bt.ground.geometry.solids import pose
from mpvi_bt.ground.marked_yaml import parse_marked
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.ground.robot.robots import model_named
from mpvi_bt.house.layout.house import House, check_house
from mpvi_bt.house.things.catalogue import Catalogue, CatalogueEntry, load_catalogue

if TYPE_CHECKING:
    from mpvi_bt.house.sim.world import Placement, SimWorld
    from mpvi_bt.house.truth.true_scene import TrueScene

HALF_M = 3.0  # half the room's width; our choice: every drive is short


class SceneBuilder:
    """A scene, put together step by step.

        world = (
            SceneBuilder()
            .fixture("table_1", "table", at=(1.3, 0.0))
            .thing("can", "can_of_soda", at=(1.0, 0.2, 0.76))
            .thing("cup", "coffee_cup")
            .in_hand("right", "cup")
            .world()
        )

    Each step gives the builder itself. The room is 6 x 6 m, its middle the origin of the world.

    Args:
        catalogue: What names of entries mean; None: the catalogue that ships.
    """

    def __init__(self, catalogue: Catalogue | None = None) -> None:
        self._catalogue = _shipped() if catalogue is None else catalogue
        self._fixtures: dict[str, dict[str, Any]] = {}
        self._things: dict[str, tuple[CatalogueEntry, tuple[float, float, float], float]] = {}
        self._held: dict[Side, str] = {}
        self._filled: dict[str, list[str]] = {}
        self._opened: dict[tuple[str, str], float] = {}
        self._base, self._robot = (0.0, 0.0, 0.0), model_named("r1")

    def fixture(self, name: str, entry: str, at: tuple[float, float], yaw_deg: float = 0.0, **more: Any) -> Self:
        """Furniture, as in a house file.

        Args:
            name: Such as "table_1".
            entry: Of the catalogue that ships.
            at: x, y of its middle [m].
            yaw_deg: Its turn.
            **more: Other keys of a fixture there.
        """
        self._fixtures[name] = {"entry": entry, "at": list(at), "yaw_deg": yaw_deg, **more}
        return self

    def opened(self, fixture: str, body: str, fraction: float = 1.0) -> Self:
        """Have a door or drawer stand open, 0 to 1 of its range."""
        self._opened[fixture, body] = fraction
        return self

    def thing(
        self,
        name: str,
        entry: str | CatalogueEntry,
        at: tuple[float, float, float] = (-2.0, -2.0, 0.001),
        yaw: float = 0.0,
    ) -> Self:
        """A movable thing, upright.

        Args:
            name: In the world.
            entry: What it is, by name or itself.
            at: x, y [m], and how high its underside is.
            yaw: Its turn [rad].
        """
        self._things[name] = (self._catalogue[entry] if isinstance(entry, str) else entry, at, yaw)
        return self

    def in_hand(self, side: Side, name: str) -> Self:
        """Have a hand hold a thing, gripped by friction, before the chest; where it was put does not matter."""
        self._held[side] = name
        return self

    def inside(self, vessel: str, *names: str) -> Self:
        """Have things lie in a vessel, dropped into it once the hands hold what they are to hold."""
        self._filled.setdefault(vessel, []).extend(names)
        return self

    def robot_at(self, x: float, y: float, yaw: float = 0.0, robot: str = "r1") -> Self:
        """Place the robot [m, rad], and choose it; the default is an r1 at the origin."""
        self._base, self._robot = (x, y, yaw), model_named(robot)
        return self

    def house(self) -> House:
        """The room alone.

        Raises:
            FileProblems: A fixture is unknown, sticks out of the room or overlaps another.
        """
        return one_room(self._fixtures)

    def world(self, render: bool = False, settled: bool = True) -> SimWorld:
        """The world, built and come to rest.

        Args:
            render: Whether pictures can be asked for.
            settled: Whether it comes to rest first.

        Raises:
            FileProblems: As of `house`.
            BackendError: A thing does not fit into the hand that is to hold it, or does not stay there.
            NoRenderingDevice: `render` was asked for on a machine that cannot.
        """
        from mpvi_bt.house.sim.world import SimWorld
        from mpvi_bt.testing.full_hands import fill, put_in_hands

        world = SimWorld(self.house(), self._placed(), np.array(self._base), render=render, robot=self._robot)
        for (fixture, body), fraction in self._opened.items():
            world.set_opening(fixture, body, fraction)
        put_in_hands(world, self._held)
        fill(world, self._filled)
        if settled:
            world.settle()
        return world

    def scene(self) -> TrueScene:
        """The scene of that world, known by simulator truth, as skills ask it. Raises as `world`."""
        from mpvi_bt.house.truth.true_scene import TrueScene

        return TrueScene(self.world())

    def _placed(self) -> Mapping[str, Placement]:
        from mpvi_bt.house.sim.world import Placement

        return {name: Placement(entry, pose(at, yaw)) for name, (entry, at, yaw) in self._things.items()}


@cache
def _shipped() -> Catalogue:
    return load_catalogue()


def one_room(fixtures: Mapping[str, Mapping[str, Any]]) -> House:
    """A house of one room, 6 x 6 m around the origin.

    Args:
        fixtures: By name, as in a house file: {"table_1": {"entry": "table", "at": [1.0, 0.0], "yaw_deg": 180}}.

    Raises:
        FileProblems: A fixture is unknown, sticks out of the room or overlaps another.
    """
    return _built(json.dumps(fixtures, default=lambda value: value.tolist()))


@cache
def _built(fixtures: str) -> House:
    hall = {
        "rect": [-HALF_M, -HALF_M, HALF_M, HALF_M],
        "floor": "#9fb0ab",
        "walls": "#f6ecd4",
        "fixtures": json.loads(fixtures),
    }
    text = json.dumps({"outside": "#efe6d6", "rooms": {"hall": hall}})
    return check_house(*parse_marked(text, "scene.yaml"), _shipped())
