"""Level faces that things stand on: floors, tables, counters, shelves, boards inside fridges and cabinets."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.hands.rooms import placed
from mpvi_bt.ground.geometry.solids import Array, pose
from mpvi_bt.house.sim.world import Placement
from mpvi_bt.house.things.catalogue import CatalogueEntry
from mpvi_bt.testing.scene_builder import HALF_M

_WALL_M = HALF_M - 0.05  # where the room's walls begin
_SLACK_M = 0.001


@dataclass(frozen=True, eq=False)
class Surface:
    """A level face and the room that it is in.

    Attributes:
        called: What a prompt calls it.
        T: (4, 4) its frame to the world: the origin in the middle of its front edge, x inward, y to the left, z up.
        depth_m, width_m: Of the part that things may stand on.
        inset_m: From the front edge to that part.
        fixtures: What the room has to have for it, as in a house file; the first one carries the face.
        opened: Doors that stand open, as in `Trial`.
        wall: Whether the room's wall is at its far end.
    """

    called: str
    T: Array
    depth_m: float
    width_m: float
    inset_m: float = 0.0
    fixtures: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    opened: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    wall: bool = False

    @property
    def name(self) -> str:
        """The thing that has the face, in the world."""
        return next(iter(self.fixtures), "floor_hall")

    @property
    def z(self) -> float:
        """Height [m]."""
        return float(self.T[2, 3])

    def at(self, u: float, v: float) -> Array:
        """(2,) x, y in the world of a place `u` [m] from the front edge, `v` to the left of the middle."""
        return (self.T @ [u, v, 0.0, 1.0])[:2]

    def put(self, entry: CatalogueEntry, spot: Array, yaw: float) -> Placement:
        """A thing standing at a place (u, v), turned by `yaw` [rad] in the world."""
        x, y = self.at(*spot.tolist()).tolist()
        return placed(entry, x, y, self.z, yaw)

    def spot(self, radius_m: float, rng: np.random.Generator) -> Array:
        """(2,) u, v of a place for a disc, as `at` takes them."""
        u = self.inset_m + radius_m + rng.uniform(0, max(self.depth_m - 2 * radius_m, 0.0))
        return np.array([u, rng.uniform(-1, 1) * max(self.width_m / 2 - radius_m, 0.0)])


def floor(rng: np.random.Generator) -> Surface:
    """The free floor."""
    return Surface("floor", pose((-0.5, 0, 0)), 1.0, 1.0)


def floor_wall(rng: np.random.Generator) -> Surface:
    """The floor along a wall."""
    return Surface("floor", pose((_WALL_M - 0.5, rng.uniform(-1, 1), 0)), 0.5, 1.0, wall=True)


def table(rng: np.random.Generator) -> Surface:
    """A free table, 42 to 80 cm high."""
    size = [rng.uniform(0.55, 0.8), rng.uniform(0.8, 1.3), rng.uniform(0.42, 0.8)]
    return _fixture("table", size, (rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3)), rng.uniform(-180, 180), size[2])


def counter(rng: np.random.Generator) -> Surface:
    """A counter at the wall, 90 cm high."""
    return _against("counter", [0.62, 1.7, 0.9], rng, 0.9, depth_m=0.38)


def table_wall(rng: np.random.Generator) -> Surface:
    """The far end of a table that stands at the wall."""
    size = [rng.uniform(0.4, 0.5), rng.uniform(0.8, 1.3), rng.uniform(0.42, 0.9)]
    return _against("table", size, rng, size[2], wall=True)


def high_shelf(rng: np.random.Generator) -> Surface:
    """The top of a shelf, 1.2 to 1.6 m high."""
    z = rng.uniform(1.2, 1.6)
    return _against("shelf", [0.34, 0.9, z], rng, z, inset_m=0.02, depth_m=0.28)


def board(rng: np.random.Generator) -> Surface:
    """A board of a tall shelf, the next board 35 cm above it."""
    wall, gap, count = 0.022, 0.35, 6
    pitch = gap + wall
    z = 0.06 + pitch * int(rng.integers(0, 4)) + wall / 2
    size = [0.36, 0.9, 0.06 + (count - 1) * pitch + wall / 2]
    return _against("shelf", size, rng, z, {"shelves": count}, inset_m=0.02, depth_m=0.26, margin_m=0.1)


def fridge(rng: np.random.Generator) -> Surface:
    """A board of an open refrigerator."""
    z = (0.098, 0.468, 0.848, 1.228)[rng.integers(4)]
    return _against("refrigerator", [0.64, 0.68, 1.75], rng, z, {}, {"door": rng.uniform(0.8, 0.95)}, 0.06, 0.3, 0.06)


def low_cabinet(rng: np.random.Generator) -> Surface:
    """A board of an open cabinet on the floor."""
    z = (0.118, 0.478)[rng.integers(2)]
    return _against("base_cabinet", [0.6, 0.6, 0.86], rng, z, {}, {"door": rng.uniform(0.8, 0.95)}, 0.06, 0.3, 0.06)


def wall_cabinet(rng: np.random.Generator) -> Surface:
    """The floor of an open cabinet on the wall, 1.35 m high."""
    opened = {"door": rng.uniform(0.8, 0.95)}
    return _against("wall_cabinet", [0.36, 0.6, 0.7], rng, 0.018, {}, opened, 0.03, 0.28, 0.06, z_m=1.35)


def sink(rng: np.random.Generator) -> Surface:
    """The bottom of a kitchen sink."""
    return _against("kitchen_sink", [0.62, 0.74, 0.9], rng, 0.7, inset_m=0.12, depth_m=0.38, margin_m=0.11)


def drawer(rng: np.random.Generator) -> Surface:
    """The bottom of a drawer that stands open; its front edge is behind the chest's front, so `u` may be negative."""
    k = int(rng.integers(3))
    opened = {f"drawer_{k + 1}": rng.uniform(0.8, 1.0)}
    size = [0.46, 0.9, 0.8]
    z = 0.06 + k * (size[2] - 0.085) / 3 + 0.026
    return _against("chest_of_drawers", size, rng, z, {}, opened, inset_m=-0.25, depth_m=0.2)


def tall_table(rng: np.random.Generator) -> Surface:
    """A table with 70 cm of room below."""
    size = [rng.uniform(0.6, 0.8), rng.uniform(1.0, 1.4), rng.uniform(0.74, 0.8)]
    return _fixture("table", size, (rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3)), rng.uniform(-180, 180), size[2])


def desk(rng: np.random.Generator) -> Surface:
    """A desk at the wall."""
    return _against("desk", [0.6, 1.2, 0.76], rng, 0.76)


def one_of(*surfaces: Callable[[np.random.Generator], Surface]) -> Callable[[np.random.Generator], Surface]:
    """A surface that is one of several."""
    return lambda rng: surfaces[rng.integers(len(surfaces))](rng)


def _against(
    entry: str, size: list[float], rng: np.random.Generator, z: float, shape: Mapping[str, Any] | None = None,
    opened: Mapping[str, float] | None = None, inset_m: float = 0.06, depth_m: float | None = None,
    margin_m: float = 0.08, z_m: float = 0.0, wall: bool = False,
) -> Surface:  # fmt: skip
    """On a fixture with its back to the wall at x = 2.95."""
    at = (_WALL_M - size[0] / 2 - _SLACK_M, rng.uniform(-1, 1))
    return _fixture(entry, size, at, 180.0, z, shape, opened, inset_m, depth_m, margin_m, z_m, wall)


def _fixture(
    entry: str, size: list[float], at: tuple[float, float], yaw_deg: float, z: float,
    shape: Mapping[str, Any] | None = None, opened: Mapping[str, float] | None = None, inset_m: float = 0.06,
    depth_m: float | None = None, margin_m: float = 0.08, z_m: float = 0.0, wall: bool = False,
) -> Surface:  # fmt: skip
    """The face at height `z` over a fixture's own origin; `margin_m` at its sides stays free."""
    name = f"{entry}_1"
    given = {"entry": entry, "at": list(at), "yaw_deg": yaw_deg, "z_m": z_m, "shape": {"size_m": size, **(shape or {})}}
    T = pose((*at, z_m), np.deg2rad(yaw_deg)) @ pose((size[0] / 2, 0, z), np.pi)
    depth = size[0] - inset_m - (0.0 if wall else inset_m) if depth_m is None else depth_m
    doors = {name: opened} if opened else {}
    called = {"base_cabinet": "cabinet", "wall_cabinet": "cabinet"}.get(entry, entry)
    return Surface(called, T, depth, size[1] - 2 * margin_m, inset_m, {name: given}, doors, wall)
