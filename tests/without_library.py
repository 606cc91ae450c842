"""Hides a library from processes that a test starts, as if it were not installed."""

from __future__ import annotations

import os
from pathlib import Path


def without(library: str, folder: Path) -> str:
    """A PYTHONPATH with which no process can import it; a file of that is written into `folder`."""
    (folder / "sitecustomize.py").write_text(f"import sys\nsys.modules['{library}'] = None\n")
    return os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH", "")]))
