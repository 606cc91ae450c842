"""Code of other people, by import path: "my_package.my_module:MyPolicy"."""

from __future__ import annotations

import importlib
import re
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mpvi_bt.errors import UserError, did_you_mean, nearest, shown

IMPORT_PATH = re.compile(r"[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")


def imported(path: str, said: str, known: Sequence[str] = ()) -> Any:
    """What a path names, in what is installed or in the current folder.

    Args:
        path: "module:name".
        said: What it was given as, to begin a message with.
        known: Other names that may have been meant.

    Raises:
        UserError: There is no such module or name in it, it raises when it is imported, or it cannot be called.
    """
    module, _, name = path.partition(":")
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)  # after what is installed, which no file here shall hide
    try:
        found = importlib.import_module(module)
    except Exception as error:
        if isinstance(error, ModuleNotFoundError) and error.name and f"{module}.".startswith(f"{error.name}."):
            where = f"neither in {here} nor among what is installed"
            hint = did_you_mean(nearest(module, known), known)
            raise UserError(f"{said}: there is no module {error.name!r}, {where}.{hint}") from None
        raise UserError(f"{said}: importing {module} raised {told(error)}") from None
    made = getattr(found, name, None)
    if made is None:
        names = [word for word in vars(found) if not word.startswith("_")]
        raise UserError(f"{said}: module {module!r} has no {shown(name)}.{did_you_mean(nearest(name, names), names)}")
    if not callable(made):
        raise UserError(f"{said}: is no class or function, but {type(made).__name__}.")
    return made


def told(error: Exception) -> str:
    """An error of somebody else's code, on one line, with its place."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    text = " ".join(f"{type(error).__name__}: {error}".split())[:300]
    return f"{text} ({last.filename}:{last.lineno})"
