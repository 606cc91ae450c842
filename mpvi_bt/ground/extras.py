"""How optional parts of mpvi_bt are installed: the one place that says it, for every message."""

from __future__ import annotations

import shlex
from pathlib import Path

from mpvi_bt.ground import paths


def install(extra: str) -> str:
    """The command that installs an extra of pyproject.toml, such as "rerun".

    mpvi_bt is in no package index yet, so it is installed from the clone that this runs from. Where it was installed
    from a wheel pip finds it in place, and adds only what the extra needs.
    """
    clone = paths.shipped()
    if not (clone / "pyproject.toml").is_file():
        return f"pip install 'mpvi_bt[{extra}]'"
    where = "." if clone == Path.cwd() else str(clone)
    return f"pip install -e {shlex.quote(f'{where}[{extra}]')}"
