"""Houses of ProcTHOR, as its JSON has them: rooms, openings and things, from above.

ProcTHOR (Deitke et al. 2022) writes x to the right, y up, z to the front [m]; from above x is our x, and z our y. A
rotation about y is clockwise from above, and 0 faces the front. Its things have middles, and no sizes.
"""

from __future__ import annotations

import gzip
import itertools
import json
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic.alias_generators import to_camel

from mpvi_bt.ground.errors import UserError, shown

MAX_BYTES = 20_000_000  # of one house; theirs have 30 to 300 kB
# Theirs have 10 rooms of 11 corners at most; the bounds keep a hostile file from taking long.
_MOST_ROOMS, _MOST_CORNERS, _MOST = 100, 40, 2000

Name = Annotated[str, Field(max_length=200, pattern=r"^[^\x00-\x1f\x7f]*$")]  # on one line
Number = Annotated[float, Field(ge=-1000, le=1000, allow_inf_nan=False)]


class ProcthorRecord(BaseModel):
    """A part of the file; what else it has is not read."""

    model_config = ConfigDict(alias_generator=to_camel, frozen=True)


class FilePlace(ProcthorRecord):
    """A place [m], or angles about three axes [deg]."""

    x: Number
    y: Number = 0.0
    z: Number


class FileRoom(ProcthorRecord):
    """A room: its type, such as "Kitchen", and the corners of its floor."""

    id: Name
    room_type: Name
    floor_polygon: Annotated[list[FilePlace], Field(min_length=3, max_length=_MOST_CORNERS)]


class FileWall(ProcthorRecord):
    """A wall of a room; `empty` ones are not built."""

    id: Name
    room_id: Name = ""
    polygon: Annotated[list[FilePlace], Field(min_length=2, max_length=200)]
    empty: bool = False


class FileOpening(ProcthorRecord):
    """A door or window in a wall: its hole, along the wall from the wall's first corner."""

    id: Name
    room0: Name
    room1: Name
    wall0: Name
    hole_polygon: Annotated[list[FilePlace], Field(min_length=2, max_length=2)]


class FileThing(ProcthorRecord):
    """A thing with the middle of the box around it, and those that stand on it."""

    id: Name
    position: FilePlace
    rotation: FilePlace
    children: Annotated[list[FileThing], Field(max_length=_MOST)] = []


class ProcthorHouse(ProcthorRecord):
    """What is read of a house; its materials, lights and colors are not."""

    rooms: Annotated[list[FileRoom], Field(min_length=1, max_length=_MOST_ROOMS)]
    walls: Annotated[list[FileWall], Field(max_length=_MOST)] = []
    doors: Annotated[list[FileOpening], Field(max_length=_MOST)] = []
    windows: Annotated[list[FileOpening], Field(max_length=_MOST)] = []
    objects: Annotated[list[FileThing], Field(max_length=_MOST)] = []

    def span(self, opening: FileOpening) -> tuple[tuple[float, float], tuple[float, float]] | None:
        """x, y of both ends of an opening; None: its wall is not in the file, or has no length."""
        wall = next((wall for wall in self.walls if wall.id == opening.wall0), None)
        if wall is None:
            return None
        start, end = wall.polygon[:2]
        dx, dy = end.x - start.x, end.z - start.z
        length = (dx * dx + dy * dy) ** 0.5
        if length < 1e-6:
            return None
        a, b = ((start.x + dx / length * hole.x, start.z + dy / length * hole.x) for hole in opening.hole_polygon)
        return a, b


def has_lines(file: Path) -> bool:
    """Whether a file is one of many houses, a line each, by its name."""
    return file.name.endswith((".jsonl", ".jsonl.gz"))


def read_procthor(file: Path, line: int = 1) -> ProcthorHouse:
    """A house of a file.

    Args:
        file: JSON of one house; or JSON lines, plain or gzipped, as ProcTHOR-10K comes.
        line: Which house of JSON lines, counted from 1.

    Raises:
        UserError: The file cannot be read, has no such line, or no house of ProcTHOR's is in it.
    """
    lines = has_lines(file)
    place = f"{file}, line {line}" if lines else f"{file}"
    try:
        data = _line(file, line) if lines else _bounded(file.read_bytes(), place)
        told = json.loads(data)
    except (OSError, EOFError, zlib.error, ValueError, RecursionError) as error:
        raise UserError(f"{place}: cannot be read: {error}") from None
    if not isinstance(told, dict):
        raise UserError(f"{place}: {shown(told)} is no house of ProcTHOR's, which is a mapping with rooms and walls")
    try:
        return ProcthorHouse.model_validate(told)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise UserError(f"{place}: no house of ProcTHOR's: {where}: {first['msg']}") from None
    except RecursionError:
        raise UserError(f"{place}: no house of ProcTHOR's: things stand on things too deep") from None


def _line(file: Path, line: int) -> bytes:
    opened: Any = gzip.open if file.suffix == ".gz" else open
    with opened(file, "rb") as source:
        found = next(itertools.islice(_lines(source), line - 1, None), None)
    if found is None:
        raise UserError(f"{file}: there is no line {line}")
    return _bounded(found, f"{file}, line {line}")


def _lines(source: Any) -> Iterator[bytes]:
    while data := source.readline(MAX_BYTES + 1):
        yield data


def _bounded(data: bytes, place: str) -> bytes:
    if len(data) > MAX_BYTES:
        raise UserError(f"{place}: more than {MAX_BYTES // 1_000_000} MB are no house of ProcTHOR's")
    return data
