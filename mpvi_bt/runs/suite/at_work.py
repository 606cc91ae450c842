"""A file in the suite's folder lists the running episodes, for other processes to read."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from pydantic import Field, TypeAdapter

from mpvi_bt.ground.marked_yaml import Record

FILE = ".at_work.json"
_MAX_BYTES = 1_000_000


class AtWork(Record):
    """An episode that a worker plays.

    Attributes:
        worker: Number of the worker, from 1.
        method, episode: Which episode; method "" where the suite names none.
        since: When it began, in seconds since 1970.
    """

    worker: Annotated[int, Field(ge=1)]
    method: str
    episode: str
    since: Annotated[float, Field(allow_inf_nan=False)]


_LIST = TypeAdapter(list[AtWork])


def note(folder: Path, works: Sequence[AtWork]) -> None:
    """Write the running episodes. A failed write does no harm."""
    path = folder / FILE
    new = path.with_suffix(".tmp")
    with contextlib.suppress(OSError):
        if not works:
            path.unlink(missing_ok=True)
            return
        new.write_text(json.dumps([work.model_dump() for work in works]), encoding="utf-8")
        new.replace(path)


def read(folder: Path) -> list[AtWork]:
    """The last list written; [] if it cannot be read. A killed run leaves its last list."""
    path = folder / FILE
    try:
        if not path.is_file():
            return []
        with path.open("rb") as file:
            return _LIST.validate_json(file.read(_MAX_BYTES))
    except (OSError, ValueError):
        return []
