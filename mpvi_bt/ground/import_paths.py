"""Code of other people: by import path, "my_package.my_module:MyPolicy", or in a file, "my_nodes.py:Blink"."""

from __future__ import annotations

import importlib
import importlib.util
import re
import sys
import traceback
import zlib
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

from mpvi_bt.ground.errors import UserError, did_you_mean, nearest, shown

IMPORT_PATH = re.compile(r"[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")


def imported(path: str, said: str, known: Sequence[str] = ()) -> Any:
    """The class or function that a path names. Raises UserError as `found_at`, and if it cannot be called."""
    made = found_at(path, said, known)
    if not callable(made):
        raise UserError(f"{said}: is no class or function, but {type(made).__name__}.")
    return made


def found_at(path: str, said: str, known: Sequence[str] = ()) -> Any:
    """The object at an import path: in an installed package, in the current folder, or in a file.

    Args:
        path: "module:name", or "folder/file.py:name".
        said: What it was given as, to begin a message with.
        known: Other names that may have been meant.

    Raises:
        UserError: There is no such module or name in it, or it raises when it is imported.
    """
    module, _, name = path.rpartition(":")
    found = module_in(Path(module), said) if module.endswith(".py") else _module(module, said, known)
    made = getattr(found, name, None)
    if made is None:
        names = [word for word, held in vars(found).items() if word[0] != "_" and not isinstance(held, ModuleType)]
        raise UserError(f"{said}: module {module!r} has no {shown(name)}.{did_you_mean(nearest(name, names), names)}")
    return made


def _module(module: str, said: str, known: Sequence[str]) -> ModuleType:
    here, first = str(Path.cwd()), module.partition(".")[0]
    if here not in sys.path and first not in sys.modules and importlib.util.find_spec(first) is None:
        sys.path.append(here)  # after what is installed, which no file here shall hide
    try:
        return importlib.import_module(module)
    except (Exception, SystemExit) as error:
        if isinstance(error, ModuleNotFoundError) and error.name and f"{module}.".startswith(f"{error.name}."):
            where = f"neither in {here} nor among what is installed"
            hint = did_you_mean(nearest(module, known), known) if known else ""
            raise UserError(f"{said}: there is no module {error.name!r}, {where}.{hint}") from None
        raise UserError(f"{said}: importing {module} raised {told(error)}") from None


def module_in(file: Path, said: str) -> ModuleType:
    """The module that a file holds, run once as long as the file stays as it is. Nothing is written beside it.

    Raises:
        UserError: It cannot be read, or raises when it is run.
    """
    try:
        file = file.resolve()
        stat = file.stat()
        return _run(file, stat.st_mtime_ns, stat.st_size)
    except OSError as error:
        if error.filename is None or Path(error.filename) != file:
            raise UserError(f"{said}: running it raised {told(error)}") from None
        raise UserError(f"{said}: {(error.strerror or 'cannot be read').lower()}.") from None
    except (Exception, SystemExit) as error:
        raise UserError(f"{said}: running it raised {told(error)}") from None


@lru_cache(maxsize=256)
def _run(file: Path, _changed_ns: int, _size: int) -> ModuleType:
    module = ModuleType(f"{file.stem}_{zlib.crc32(bytes(file)):08x}")  # no name that an import could mean
    module.__file__ = str(file)
    code = compile(file.read_bytes(), str(file), "exec")
    sys.modules[module.__name__] = module  # where dataclasses look for the names of annotations
    try:
        exec(code, vars(module))
    except BaseException:
        del sys.modules[module.__name__]
        raise
    return module


def told(error: BaseException) -> str:
    """An error of somebody else's code, on one line, with its place."""
    text = " ".join(f"{type(error).__name__}: {error}".split())[:300]
    if isinstance(error, SyntaxError) and error.filename:
        text = " ".join(f"{type(error).__name__}: {error.msg}".split())[:300]
        return f"{text} ({error.filename}:{error.lineno}:{error.offset})"
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{text} ({last.filename}:{last.lineno})"
