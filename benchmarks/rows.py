"""Results, one JSON object a line: a killed run goes on where it stopped."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from mpvi_bt.ground.errors import UserError


def lines_of(path: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    """Number and object of each line of a file, if there is one; a last line that was cut short does not count.

    Raises:
        UserError: A line is no JSON object.
    """
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True) if path.exists() else []
    for number, line in enumerate(lines, start=1):
        if not line.endswith("\n"):
            return
        try:
            data = json.loads(line)
        except ValueError as error:
            raise UserError(f"{path}:{number}: no JSON ({error})") from None
        if not isinstance(data, dict):
            raise UserError(f"{path}:{number}: no JSON object")
        yield number, data


def append(path: Path, data: Mapping[str, Any]) -> None:
    """Append a line, whole; a half-written line before it is cut off first.

    Raises:
        UserError: The file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("ab+") as file:
            size = file.tell()
            if size:
                file.seek(0)
                whole = file.read().rfind(b"\n") + 1
                if whole != size:
                    file.truncate(whole)
            file.write(json.dumps(data).encode() + b"\n")
    except OSError as error:
        raise UserError(f"{path}: {(error.strerror or 'cannot be written').lower()}") from None
