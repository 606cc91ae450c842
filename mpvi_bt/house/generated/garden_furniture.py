"""The garden of a generated house: a lawn with trees, a driveway, a table."""

from __future__ import annotations

from mpvi_bt.house.generated.placement import Furnishing, NoRoom, RoomFloor
from mpvi_bt.house.generated.plane import SIDES, WallFrame, grown
from mpvi_bt.house.generated.tints import Tints

_HEDGE_M = 0.3
_SLAB_M = 0.01
_DRIVE_M = 3.0  # wide
_TREES = 6  # the first two bear fruit
_APART_M = 1.55  # between trunks, along x or y: crowns do not touch
_DRAWS = 60


def garden(room: RoomFloor, tints: Tints) -> None:
    """Furnish a garden. Raises NoRoom."""
    x0, y0, x1, y1 = room.rect
    long_x = x1 - x0 > y1 - y0
    drive_first = _drive_first(room, long_x)
    frame = WallFrame(grown(room.rect, -_HEDGE_M - 0.05), "south" if long_x else "west")
    length, depth = frame.length_m, frame.depth_m
    drive = (0.0, _DRIVE_M) if drive_first else (length - _DRIVE_M, length)
    lawn = (_DRIVE_M + 0.7, length - 0.2) if drive_first else (0.2, length - _DRIVE_M - 0.7)
    _slab(room, "driveway_1", "driveway", frame, drive, (0.0, depth))
    house = next((opening.side for opening in room.openings), "south")
    near = 1.7 if house in ("south", "west") else 0.1  # the terrace lies by the house
    _slab(room, "lawn_1", "lawn", frame, lawn, (near, depth - (1.8 - near)))
    _table(room, tints)
    _trees(room, frame, lawn, (near, depth - (1.8 - near)))


def _drive_first(room: RoomFloor, long_x: bool) -> bool:
    """Whether the driveway is where the garden begins: where the widest doorway is, which is the garage's."""
    widest = max(room.openings, key=lambda opening: opening.width_m)
    x0, y0, x1, y1 = room.rect
    if widest.width_m < 2.0:
        return bool(room.rng.random() < 0.5)
    return widest.middle_m < ((x1 - x0) if long_x else (y1 - y0)) / 2


def _slab(
    room: RoomFloor, name: str, entry: str, frame: WallFrame, u: tuple[float, float], v: tuple[float, float]
) -> None:
    area = frame.area(*u, *v)
    x0, y0, x1, y1 = area
    shape = {"size_m": [round(x1 - x0, 2), round(y1 - y0, 2), _SLAB_M]}
    room.add([Furnishing(name, entry, ((x0 + x1) / 2, (y0 + y1) / 2), 0.0, area, (0.0, _SLAB_M), 0.0, shape)])


def _table(room: RoomFloor, tints: Tints) -> None:
    """Put up a round table with two chairs beside the house."""
    wood = tints.second_wood
    for _ in range(_DRAWS):
        side = SIDES[int(room.rng.integers(4))]
        if side not in {opening.side for opening in room.openings}:
            continue
        frame = room.frame(side)
        u = float(room.rng.uniform(1.4, frame.length_m - 1.4))
        shape = {"size_m": [0.9, 0.9, 0.72], "color": wood, "round_top": True}
        pieces = [room.piece("garden_table", "table", frame, u, 0.45, shape=shape, z_m=0.0)]
        for number, sign in ((1, -1), (2, 1)):
            toward_high = side in ("north", "west")
            turn = 90.0 if (sign < 0) == toward_high else 270.0
            at = u + sign * 0.8
            chair = room.piece(f"garden_chair_{number}", "chair", frame, at, 0.69, turn_deg=turn, shape={"color": wood})
            pieces.append(chair)
        ground = [piece for piece in room.pieces if piece.name in ("lawn_1", "driveway_1")]
        clear = all(_apart(piece, slab) for piece in pieces for slab in ground)
        if clear and room.fits(pieces):
            room.add(pieces)
            return
    raise NoRoom("a garden table")


def _apart(piece: Furnishing, slab: Furnishing) -> bool:
    a, b = piece.area, slab.area
    return a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]


def _trees(room: RoomFloor, frame: WallFrame, u: tuple[float, float], v: tuple[float, float]) -> None:
    """Plant trees on the lawn, apart from each other."""
    trunks: list[tuple[float, float]] = []
    for number in range(1, _TREES + 1):
        for _ in range(_DRAWS):
            place = float(room.rng.uniform(u[0] + 0.7, u[1] - 0.7)), float(room.rng.uniform(v[0] + 0.6, v[1] - 0.6))
            x, y = (round(c, 2) for c in frame.point(*place))
            height, crown = (round(float(room.rng.uniform(*bounds)), 2) for bounds in ((2.5, 3.1), (1.2, 1.5)))
            area = grown((x, y, x, y), crown / 2)  # a robot's head does not pass below
            shape = {"height_m": height, "crown_m": crown}
            entry = "fruit_tree" if number <= 2 else "tree"
            tree = Furnishing(f"tree_{number}", entry, (x, y), 0.0, area, (_SLAB_M, 3.0), _SLAB_M, shape)
            if all(max(abs(x - a), abs(y - b)) > _APART_M for a, b in trunks) and room.fits([tree]):
                room.add([tree])
                trunks.append((x, y))
                break
        else:
            raise NoRoom("a tree")
