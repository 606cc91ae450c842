"""Where trees, skills, tasks, robots and settings of policies are: shipped with mpvi_bt, and in a user's own folders.

A root is a folder that holds `trees/`, `skills/`, `tasks/`, `policies/`, `robots/` and `bridges/`. Folders named in
the environment variable `MPVI_PATH` (separated by ":", as in PATH) are searched first, so that a user's file of the
same name wins; then comes what mpvi_bt ships, inside the installed package or in a checkout.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from mpvi_bt.ground.errors import UnknownName, UserError
from mpvi_bt.ground.near_file import near_file

_PACKAGE = Path(__file__).resolve().parents[1]
SUFFIXES = (".yaml", ".yml", ".json")  # of data files; of namesakes in one folder the first one counts
_FOLDERS = ("trees", "skills", "tasks", "policies", "robots", "bridges")


def shipped() -> Path:
    """The root that comes with mpvi_bt: inside the wheel, or the checkout of an editable install."""
    inside = _PACKAGE / "_data"
    return inside if inside.is_dir() else _PACKAGE.parent


def roots() -> list[Path]:
    """Every root, in the order of search.

    Raises:
        UserError: `MPVI_PATH` names something that is not a folder, or `trees/` itself, not the folder that holds it.
    """
    own = [Path(p).expanduser() for p in os.environ.get("MPVI_PATH", "").split(os.pathsep) if p]
    for root in own:
        if not root.is_dir():
            raise UserError(f"MPVI_PATH: {root} is not a folder. It names folders, separated by {os.pathsep!r}.")
        if root.name in _FOLDERS and not any((root / folder).is_dir() for folder in _FOLDERS):
            raise UserError(f"MPVI_PATH: {root}: name the folder that holds {root.name}/, which is {root.parent}.")
    return [*own, shipped()]


def caches() -> list[Path]:
    """Folders for caches: the user's cache, or else this user's folder among temporary files."""
    cache_home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return [Path(cache_home) / "mpvi_bt", Path(tempfile.gettempdir()) / f"mpvi_bt-{os.getuid()}"]


def files(folder: str) -> list[Path]:
    """The YAML and JSON files in `folder`, such as "tasks/plans", of every root: of namesakes the first one counts."""
    return [path for root in roots() for path in files_in(root / folder)]


def files_in(folder: Path) -> list[Path]:
    """The YAML and JSON files in one folder, by name: of namesakes the first one counts."""
    found = [p for p in folder.glob("*") if p.suffix in SUFFIXES and is_file(p) and not p.name.startswith(".")]
    return sorted(found, key=lambda path: (path.stem, SUFFIXES.index(path.suffix)))


def names(folder: str) -> list[str]:
    """Stems of the YAML and JSON files in `folder` of every root; sorted, each once."""
    return sorted({path.stem for path in files(folder)})


def title(file: str | os.PathLike[str]) -> str:
    """The stem of a file after which a folder of results is named.

    Raises:
        UserError: It would name another folder, such as the one above, or one that is hidden.
    """
    stem = Path(file).stem
    if stem.startswith("."):
        raise UserError(f"{file}: a folder of results is named after it, and none can be {stem!r}; rename the file.")
    return stem


def kind_in(folder: str) -> str:
    """What a file in a folder is, such as "tree" in "trees" or "plan" in "tasks/plans"."""
    last = Path(folder).name
    return "policy settings" if last == "policies" else last.removesuffix("s")


def is_file(path: Path) -> bool:
    """Whether there is such a file; False, not an error, for a name that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):  # ValueError: NUL in the name
        return False


def is_folder(path: Path) -> bool:
    """Whether there is such a folder; False, not an error, for a name that no folder can have."""
    try:
        return path.is_dir()
    except OSError:
        return False


def find(folder: str, name: str, kind: str = "") -> Path:
    """The file of a name, such as ("tasks", "picking_up_trash").

    Args:
        folder: Relative to a root.
        name: Stem of the file.
        kind: What to call it in the error; what the folder holds by default.

    Raises:
        UnknownName: No root has such a file.
    """
    if (found := next((path for path in files(folder) if path.stem == name), None)) is None:
        raise UnknownName(kind or kind_in(folder), name, names(folder))
    return found


def find_or_file(folder: str, given: str, kind: str = "") -> Path:
    """The file that a user means: a known name, or else a path, of a pipe too.

    What has a slash or the suffix of a file of ours is always a path.

    Raises:
        UserError: It looks like a path and there is no such file, or it is a folder.
        UnknownName: It looks like a name and no root has it.
    """
    path = Path(given)
    is_path = os.sep in given or given.endswith(SUFFIXES)
    if not is_path and given in names(folder):
        return find(folder, given, kind)
    try:
        there, is_folder = path.exists(), path.is_dir()
    except OSError:  # no file can have such a name
        there = is_folder = False
    if given and is_folder:
        raise UserError(f"{given}: is a folder; name a file in it.")
    if given and there:
        return path
    if is_path or path.suffix:
        raise UserError(f"{given}: there is no such file.{near_file(path)}")
    beside = [f"{given}{suffix}" for suffix in SUFFIXES if is_file(Path(f"{given}{suffix}"))]
    if beside:
        what = kind or kind_in(folder)
        raise UserError(f"unknown {what} {given!r}, but there is a file {beside[0]}: name it with its suffix.")
    return find(folder, given, kind)
