"""The rate of a dataset of LeRobot's, or of a recorded demonstration: frames a second."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from mpvi_bt.ground.errors import UserError, shown
from mpvi_bt.ground.robot.action_rows import check_rate

_FILES = ("meta/info.json", "episode.json")  # LeRobot's datasets of all versions, and our recordings


def dataset_rate(folder: Path) -> float:
    """Rows a second, as the dataset in a folder says.

    Raises:
        UserError: There is no dataset, or it does not say.
    """
    file = next((folder / name for name in _FILES if (folder / name).is_file()), None)
    if file is None:
        raise UserError(f"{folder}: no dataset of LeRobot's (meta/info.json) and no recorded demonstration is there")
    try:
        told = json.loads(file.read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise UserError(f"{file}: cannot be read: {error}") from None
    fps = told.get("fps") if isinstance(told, Mapping) else None
    try:
        return check_rate(fps)  # type: ignore[arg-type]  # it says what it is given
    except UserError:
        raise UserError(f"{file}: 'fps' is the rows a second, such as 30, not {shown(fps)}") from None
