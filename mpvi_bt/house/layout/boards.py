"""Level places to put things at the start: tops of furniture, boards inside it, other things, the floor under a desk.

A thing is put where it lies on a board with all of it, keeps a gap to everything around, and can be reached. The gap is
as wide as the number of things allows: a hand has room around each where there are few.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.errors import BackendError
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array, Solid, bounds, pose
from mpvi_bt.ground.robot.collision import Surroundings
from mpvi_bt.house.things.catalogue import CatalogueEntry

# All our choice.
DROP_M = 0.001  # things are let go of so far above what carries them
ASKEW_RAD = 0.25  # how far what is laid square is turned from it, at the most
ONE_HAND_M = 0.085
FRONT_M = 0.35  # from the front of a cabinet or shelf to the middle of a thing in it, at the most,
TWO_HANDS_FRONT_M = 0.10  # and to the near edge of one that takes two hands
ABOVE_M = 0.05  # over a thing on a board, so that a hand gets in
# Gaps to everything around, the widest that all have room with: a hand's fingers pass through the first three.
GAPS_M = (0.10, 0.06, 0.035, 0.02, 0.01)
FREELY_M = 0.06  # with gaps this wide things are turned anyhow, with narrower ones they lie along their board
_EDGE_M = 0.03  # from a board's edge, or half a gap if that is less
_SPOTS = 160  # that are tried on a board,
_ROUNDS = 3  # and how often all things of a place are tried with one gap
_STEP_M = 0.04
_FLUSH_M = 0.005
_ROOM_M = 0.6  # over a board in which things may be in the way


@dataclass(frozen=True, eq=False)
class MovableForm:
    """The form of a movable thing as it begins.

    Attributes:
        entry: What it is.
        openings: Its joints that are not closed: body to opening, 0 to 1.
    """

    entry: CatalogueEntry
    openings: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def solids(self) -> list[Solid]:
        """What collides, in its body frame."""
        return list(self.entry.description.solids(openings=self.openings))

    @cached_property
    def points(self) -> Array:
        """(n, 3) points all over its surface, in its body frame."""
        points = np.concatenate([_surface(solid) for solid in self.solids])
        return np.unique(np.round(points, 3), axis=0)

    @cached_property
    def extent(self) -> Array:
        """(2, 3) lowest and highest corner, in its body frame."""
        return bounds(self.solids)

    @property
    def radius(self) -> float:
        """Of the circle around it, seen from above [m]."""
        return float(np.hypot(*np.ptp(self.extent, axis=0)[:2])) / 2

    @cached_property
    def two_hands(self) -> bool:
        """Whether it is carried, too broad for one hand, and has no rim or bar to take it by."""
        size, root = np.ptp(self.extent, axis=0), self.entry.description.root
        broad = size[:2].min() > ONE_HAND_M and not root.volumes and not root.handles
        return bool(broad and not self.entry.at_back)

    @property
    def faces(self) -> float | None:
        """Direction of its x axis, from the viewing direction of a person in front of it [rad]; None: any."""
        if self.entry.at_back or self.entry.description.jointed:
            return np.pi  # what has a lid or a screen looks at whoever stands there
        return 0.0 if self.two_hands else None


@dataclass(frozen=True, eq=False)
class Put:
    """A thing in its place: `shape` at `T` (4, 4, body to world)."""

    shape: MovableForm
    T: Array

    @cached_property
    def solids(self) -> list[Solid]:
        """What collides, in the world."""
        return [solid.moved(self.T) for solid in self.shape.solids]

    @cached_property
    def points(self) -> Array:
        """(n, 3) points all over its surface, in the world."""
        return np.asarray(matmul(self.shape.points, self.T[:3, :3].T) + self.T[:3, 3])

    @cached_property
    def around(self) -> Around:
        """What others have to keep clear of."""
        return Around(self.solids)

    @cached_property
    def box(self) -> Array:
        """(2, 3) lowest and highest corner, in the world."""
        return bounds(self.solids)


class Around:
    """Solids that stand there already, in the world, with the boxes around them."""

    def __init__(self, solids: Sequence[Solid]) -> None:
        self.solids = solids
        self._boxes = np.array([solid.aabb() for solid in solids]).reshape(-1, 2, 3)

    def near(self, box: Array, gap: float) -> list[Solid]:
        """Those that come nearer than a gap [m] to a box (2, 3)."""
        close = (self._boxes[:, 0] < box[1] + gap).all(1) & (box[0] - gap < self._boxes[:, 1]).all(1)
        return [self.solids[k] for k in np.flatnonzero(close).tolist()]


@dataclass(frozen=True, eq=False)
class Board:
    """A level face that carries things.

    Attributes:
        face: A solid in the world, upright, whose upper face it is.
        owner: Solids in the world of what it belongs to.
        sky: What of its owner is straight above the middle of a thing: "free", nothing; "covered", something; "any".
        front: Whether it is used from the side that its face's x axis points to; else from above and all around.
        heading: (n, 2) places to the way (n,) [rad] in which someone looks who stands before them.
        reach: (n, 2) places to (n,) bool, for one hand and for two.
    """

    face: Solid
    owner: Sequence[Solid]
    sky: Literal["free", "covered", "any"]
    front: bool
    heading: Callable[[Array], Array]
    reach: Callable[[Array, bool], NDArray[np.bool_]]

    @property
    def height(self) -> float:
        """Of its face [m]."""
        return float(self.face.T[2, 3] + self.face.half_m[2])

    @property
    def rank(self) -> tuple[float, float]:
        """What boards are ranked by: the broadest first, of those as broad the highest."""
        return -round(float(np.prod(np.ptp(self.face.aabb(), axis=0)[:2])), 2), -self.height


def put_all(
    shapes: Mapping[str, MovableForm],
    boards: Sequence[Board],
    around: Sequence[Around],
    rng: np.random.Generator,
    *,
    shuffled: bool = False,
) -> dict[str, Put]:
    """Place things on boards, all of them with as wide a gap as there is room for.

    Args:
        shapes: By name.
        boards: From the best to the worst.
        around: All that stands there already, without the boards' owners.
        rng: Source of the draw.
        shuffled: Whether all boards are as good.

    Raises:
        BackendError: There is no room for some of them; its text names the first.
    """
    largest_first = sorted(shapes, key=lambda name: -shapes[name].radius)
    stuck = largest_first[0] if largest_first else ""
    sites = [_Site(board, around) for board in boards]
    for gap in GAPS_M:
        for _ in range(_ROUNDS):
            done: dict[str, Put] = {}
            for name in largest_first:
                order = [sites[k] for k in rng.permutation(len(sites))] if shuffled else sites
                puts = (site.put(shapes[name], list(done.values()), gap, rng) for site in order)
                put = next((put for put in puts if put is not None), None)
                if put is None:
                    stuck = name
                    break
                done[name] = put
            else:
                return {name: done[name] for name in shapes}
    raise BackendError(f"no room for {stuck}, of radius {shapes[stuck].radius:.2f} m")


def heap(
    shapes: Mapping[str, MovableForm], volume: Solid, owner: Sequence[Solid], rng: np.random.Generator
) -> dict[str, Put]:
    """Drop things into a container, one on the other where they have no room side by side, as low as they find.

    Args:
        shapes: By name.
        volume: What holds them, in the world.
        owner: Solids in the world of the container.
        rng: Source of the draw.

    Raises:
        BackendError: They do not fit.
    """
    done: dict[str, Put] = {}
    walls = Surroundings([*owner])
    low, high = volume.aabb()
    for name in sorted(shapes, key=lambda name: -shapes[name].radius):
        shape = shapes[name]
        size = np.ptp(shape.extent, axis=0)
        best: Array | None = None
        spots, turns = _spots(volume, shape, 0.0, rng, None)
        for spot, turn in zip(spots, turns, strict=True):
            T = pose(np.append(spot, low[2] + DROP_M - shape.extent[0, 2]), turn)
            flat = matmul(shape.points, T[:3, :3].T) + T[:3, 3]
            if walls.distance(flat).min() <= 0:
                continue
            corners = flat.min(0)[:2], flat.max(0)[:2]
            below = [put.box[1, 2] for put in done.values() if _over(put.box, *corners)]
            z = max(below, default=float(low[2])) + 2 * DROP_M
            T[2, 3] = z - shape.extent[0, 2]
            if z + size[2] / 2 < high[2] - 0.01 and (best is None or T[2, 3] < best[2, 3]):
                best = T
        if best is None:
            raise BackendError(f"no room for {name}, of radius {shape.radius:.2f} m, in a container")
        done[name] = Put(shape, best)
    return {name: done[name] for name in shapes}


def balanced(shape: MovableForm, carrier: Put, around: Sequence[Around], rng: np.random.Generator) -> Put | None:
    """A place on the middle of a smaller thing, such as a keyboard's on a notebook; None if it is not free."""
    low, high = bounds(carrier.solids)
    yaw = float(np.arctan2(carrier.T[1, 0], carrier.T[0, 0]))
    for turn in rng.permutation(4):
        T = pose(np.append((low + high)[:2] / 2, high[2] + DROP_M - shape.extent[0, 2]), yaw + turn * np.pi / 2)
        T[:2, 3] += matmul(T[:2, :2], -shape.extent.mean(0)[:2]) + rng.uniform(-0.005, 0.005, 2)
        put = Put(shape, T)
        near = _near_to(around, put.box, 0.0)
        if not near or Surroundings(near).distance(put.points).min() > 0:
            return put
    return None


def _over(box: Array, low: Array, high: Array) -> bool:
    return bool((box[0, :2] < high).all() and (low < box[1, :2]).all())


class _Site:
    """A board with what is near it."""

    def __init__(self, board: Board, around: Sequence[Around]) -> None:
        self._board = board
        low, high = board.face.aabb()
        room = np.array([[*low[:2], board.height + _FLUSH_M], [*high[:2], board.height + _ROOM_M]])
        near = _near_to([*around, Around(board.owner)], room, GAPS_M[0])
        self._obstacles = Surroundings([s for s in near if s is not board.face and s.aabb()[1, 2] > room[0, 2]])
        self._owner, self._top = Surroundings(board.owner), float(bounds(board.owner)[1, 2])

    def put(self, shape: MovableForm, placed: Sequence[Put], gap: float, rng: np.random.Generator) -> Put | None:
        """The thing in a place on the board, with a gap [m] to all around; None if none was found."""
        board = self._board
        margin = min(_EDGE_M, gap / 2)
        if np.ptp(shape.extent, axis=0)[:2].min() > 2 * (board.face.half_m[:2].min() - margin):
            return None
        spots, yaw = _spots(board.face, shape, margin, rng, board.heading, gap < FREELY_M)
        shift = np.column_stack([spots, np.full(len(spots), board.height + DROP_M - shape.extent[0, 2])])
        c, s, zero, one = np.cos(yaw), np.sin(yaw), np.zeros(len(yaw)), np.ones(len(yaw))
        R = np.stack([c, -s, zero, s, c, zero, zero, zero, one], 1).reshape(-1, 3, 3)
        at = matmul(shape.points, R.transpose(0, 2, 1)) + shift[:, None]
        middle = (at.min(1) + at.max(1)) / 2
        good = board.reach(middle[:, :2], shape.two_hands) & _carried(board.face, at, margin)
        if board.front:
            good &= _in_front(board.face, middle, at, shape.two_hands)
        rest = self._clear(at, middle, np.flatnonzero(good), gap)
        if shape.entry.at_back:
            rest = rest[np.argsort(-self._depth(middle[rest, :2]), kind="stable")]
        for k in rest:
            put = Put(shape, pose(shift[k], float(yaw[k])))
            if all(_apart(put, other, gap) for other in placed):
                return put
        return None

    def _depth(self, spots: Array) -> Array:
        """(n,) how far back places (n, 2) are, as seen by someone who stands before their middle [m]."""
        if not len(spots):
            return np.zeros(0)
        (ahead,) = self._board.heading(spots.mean(0, keepdims=True))
        return np.asarray(matmul(spots, [np.cos(ahead), np.sin(ahead)]))

    def _clear(self, at: Array, middle: Array, rest: NDArray[np.intp], gap: float) -> NDArray[np.intp]:
        """The free places with the right sky; the thing's points there are `at` (n, p, 3)."""
        if self._board.sky != "any":
            covered = self._covered(at[rest], middle[rest])
            rest = rest[covered if self._board.sky == "covered" else ~covered]
        rest = rest[(self._obstacles.distance(at[rest]) > gap).all(1)]
        if self._board.front:
            raised = at[rest] + [0, 0, ABOVE_M]
            rest = rest[(self._obstacles.distance(raised) > 0).all(1)]
        return rest

    def _covered(self, at: Array, middle: Array) -> NDArray[np.bool_]:
        """(n,) bool: something of the board's owner is straight above the middles (n, 3) of things."""
        if not len(at):
            return np.zeros(0, bool)
        start = float(at[..., 2].max()) + 0.01
        rise = np.arange(start, max(self._top, start) + 0.02, 0.01)
        column = np.repeat(middle[:, None], len(rise), 1)
        column[..., 2] = rise
        return np.asarray((self._owner.distance(column) <= 0).any(1))


def _spots(
    face: Solid,
    shape: MovableForm,
    margin: float,
    rng: np.random.Generator,
    heading: Callable[[Array], Array] | None,
    along: bool = True,
) -> tuple[Array, Array]:
    """Places (n, 2) on a face and the turns (n,) [rad] of a thing there; `along`: turned as the face is, about."""
    thin = float(np.ptp(shape.extent, axis=0)[:2].min()) / 2
    half = np.maximum(face.half_m[:2] - margin - thin, 0.0)
    spots = matmul(rng.uniform(-half, half, (_SPOTS, 2)), face.T[:2, :2].T) + face.T[:2, 3]
    turns = rng.uniform(-np.pi, np.pi, _SPOTS)
    if heading is not None and shape.faces is not None:
        turns = heading(spots) + shape.faces + turns * ASKEW_RAD / np.pi
    elif along:
        square = np.round(turns / (np.pi / 2)) * np.pi / 2
        turns = float(np.arctan2(face.T[1, 0], face.T[0, 0])) + square + (turns - square) * ASKEW_RAD
    x, y = shape.extent.mean(0)[:2]
    c, s = np.cos(turns), np.sin(turns)
    return spots - np.column_stack([c * x - s * y, s * x + c * y]), turns


def _carried(face: Solid, at: Array, margin: float) -> NDArray[np.bool_]:
    """(n,) bool: all points (n, p, 3) of a thing are over a face, that far from its edge."""
    local = matmul(at[..., :2] - face.T[:2, 3], face.T[:2, :2])
    if face.kind == "cylinder":
        return np.asarray((np.hypot(local[..., 0], local[..., 1]) <= face.half_m[0] - margin).all(1))
    return np.asarray((np.abs(local) <= face.half_m[:2] - margin).all((1, 2)))


def _in_front(face: Solid, middle: Array, at: Array, two_hands: bool) -> NDArray[np.bool_]:
    """(n,) bool: things are near enough to the front edge of a face."""
    front = matmul(face.T[:3, :3], [1.0, 0, 0])[:2]
    edge = float(matmul(face.T[:2, 3], front) + face.half_m[0])
    if two_hands:
        return np.asarray(edge - matmul(at[..., :2], front).max(1) <= TWO_HANDS_FRONT_M)
    return np.asarray(edge - matmul(middle[:, :2], front) <= FRONT_M)


def _near_to(around: Sequence[Around], box: Array, gap: float) -> list[Solid]:
    return [solid for some in around for solid in some.near(box, gap)]


def _near(box: Array, other: Array, gap: float) -> bool:
    """Whether two boxes (2, 3) are nearer to each other than a gap [m] along every axis."""
    return bool((box[0] < other[1] + gap).all() and (other[0] - gap < box[1]).all())


def _apart(put: Put, other: Put, gap: float) -> bool:
    """Whether two things keep a gap [m], by the points of either."""
    if not _near(put.box, other.box, gap):
        return True
    mine = Surroundings(put.solids).distance(other.points).min()
    return bool(min(mine, Surroundings(other.solids).distance(put.points).min()) > gap)


def _surface(solid: Solid) -> Array:
    """(n, 3) points on a solid's surface, 4 cm apart at the most, corners and rims among them."""
    h = solid.half_m
    if solid.kind == "box":
        axes = [np.linspace(-x, x, max(2, int(np.ceil(2 * x / _STEP_M)) + 1)) for x in h]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
        local = grid[(np.abs(grid) > h - 1e-9).any(1)]
    else:
        count = max(12, int(np.ceil(2 * np.pi * h[0] / _STEP_M)))
        angles = np.arange(count) * 2 * np.pi / count
        ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(count)], -1)
        levels = np.linspace(-h[2], h[2], max(2, int(np.ceil(2 * h[2] / _STEP_M)) + 1))
        if solid.kind == "sphere":
            levels = h[0] * np.sin(np.linspace(-np.pi / 2, np.pi / 2, 7))
            radii = np.sqrt(np.maximum(h[0] ** 2 - levels**2, 0.0))
        else:
            radii = np.full(len(levels), h[0])
        local = np.concatenate([ring * [r, r, 0] + [0, 0, z] for r, z in zip(radii, levels, strict=True)])
        local = np.concatenate([local, [[0, 0, -h[2]], [0, 0, h[2]]]])
    return np.asarray(matmul(local, solid.T[:3, :3].T) + solid.T[:3, 3])


def floor_of(volume: Solid) -> Solid:
    """The bottom of a container volume, as a flat solid that things lie on."""
    T = volume.T.copy()
    T[:3, 3] -= T[:3, 2] * volume.half_m[2]
    return Solid("cylinder" if volume.kind == "cylinder" else "box", np.array([*volume.half_m[:2], 0.0]), T)
