"""The file that a user may have meant, where there is none of a name."""

from __future__ import annotations

import itertools
from pathlib import Path

from mpvi_bt.ground.errors import nearest

_MOST_BESIDE = 2000  # entries of a folder that are looked through


def near_file(path: Path, before: str = " ") -> str:
    """Where there is no file, but one of nearly its name in its folder: a question that names that; else "".

    Args:
        path: Of the file.
        before: Comes before the question.
    """
    try:
        found = [one.name for one in itertools.islice(path.absolute().parent.iterdir(), _MOST_BESIDE)]
    except (OSError, ValueError):
        return ""
    name = nearest(path.name, found)
    return f"{before}Did you mean {str(path.with_name(name))!r}?" if name is not None and name != path.name else ""
