"""Where trees, skills and tasks are: in the installed package, in a checkout, and in a user's own folders.

A root is a folder that holds `trees/`, `skills/` and `tasks/`. Folders named in the environment variable `MPVI_PATH`
(separated as in PATH) are searched first, so that a user's file of the same name wins; then comes what mpvi_bt ships.
"""

from __future__ import annotations

import os
from pathlib import Path

from mpvi_bt.errors import UnknownName, UserError

_PACKAGE = Path(__file__).resolve().parent
_SUFFIXES = (".yaml", ".json")


def shipped() -> Path:
    """The root that comes with mpvi_bt: inside the wheel, or the checkout of an editable install."""
    inside = _PACKAGE / "_data"
    return inside if inside.is_dir() else _PACKAGE.parent


def roots() -> list[Path]:
    """Every root, in the order of search.

    Raises:
        UserError: `MPVI_PATH` names something that is not a folder.
    """
    own = [Path(p).expanduser() for p in os.environ.get("MPVI_PATH", "").split(os.pathsep) if p]
    for root in own:
        if not root.is_dir():
            raise UserError(f"MPVI_PATH: {root} is not a folder.")
    return [*own, shipped()]


def names(folder: str) -> list[str]:
    """Stems of the YAML and JSON files in `folder`, such as "tasks/plans", of every root; sorted, each once."""
    files = (path for root in roots() for path in (root / folder).glob("*") if path.suffix in _SUFFIXES)
    return sorted({path.stem for path in files if is_file(path) and not path.name.startswith(".")})


def is_file(path: Path) -> bool:
    """Whether there is such a file; False, not an error, for a name that no file can have."""
    try:
        return path.is_file()
    except OSError:
        return False


def find(folder: str, name: str, kind: str = "") -> Path:
    """The file of a name, such as ("tasks", "picking_up_trash").

    Args:
        folder: Relative to a root.
        name: Stem of the file.
        kind: What to call it in the error; the folder's name without its last letter by default.

    Raises:
        UnknownName: No root has such a file.
    """
    known = names(folder)
    if name not in known:
        raise UnknownName(kind or Path(folder).name.removesuffix("s"), name, known)
    places = [root / folder / f"{name}{suffix}" for root in roots() for suffix in _SUFFIXES]
    return next(path for path in places if is_file(path))


def find_or_file(folder: str, given: str, kind: str = "") -> Path:
    """The file that a user means: a path if it looks like one (it has a suffix or a slash), else a known name.

    Raises:
        UserError: It looks like a path and there is no such file.
        UnknownName: It looks like a name and no root has it.
    """
    if given.endswith(_SUFFIXES) or os.sep in given:
        path = Path(given)
        if not is_file(path):
            raise UserError(f"{given}: there is no such file.")
        return path
    return find(folder, given, kind)
