"""What the first call costs in a new process: imports, and compilation that is or is not in numba's cache yet."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator

_OURS = {
    "A*, nearest frontier": "from mpvi_bt.finding.navigation.grid import warm",
    "visibility": "from mpvi_bt.finding.scene.visibility import warm",
    "frontiers": "from mpvi_bt.finding.navigation.frontiers import warm",
    "occupancy": "from mpvi_bt.finding.scene.occupancy import warm",
}
_THEIRS = {
    "tcod": "import tcod.path; warm = lambda: tcod.path.AStar(np.ones((9, 9), 'f')).get_path(0, 0, 8, 8)",
    "skimage": "from skimage.graph import MCP_Geometric as M; warm = lambda: M(np.ones((9, 9))).find_costs([(0, 0)])",
    "pyastar2d": "import pyastar2d; warm = lambda: pyastar2d.astar_path(np.ones((9, 9), 'f'), (0, 0), (8, 8))",
    "cv2": "import cv2; warm = lambda: cv2.dilate(np.ones((9, 9), 'u1'), None)",
}
_MEASURED = """
import time, numpy as np
began = time.perf_counter()
{given}
imported = time.perf_counter()
warm()
first = time.perf_counter()
warm()
print(imported - began, first - imported, time.perf_counter() - first)
"""


def first_calls() -> Iterator[tuple[str, float, float, float]]:
    """What, import [s], first call [s], second call [s]; ours with an empty cache, then with what that left there."""
    with tempfile.TemporaryDirectory() as cache:
        for kind in ("cold", "cached"):
            for name, given in {**_OURS, "all four": _all()}.items() if kind == "cached" else _OURS.items():
                yield f"ours, {kind}: {name}", *_measured(given, cache)
    for library, given in _THEIRS.items():
        if importlib.util.find_spec(library):
            yield library, *_measured(given, "")


def _all() -> str:
    """Every part of ours in one process."""
    lines = [f"{given} as warm_{at}" for at, given in enumerate(_OURS.values())]
    return "\n".join([*lines, f"warm = lambda: [{', '.join(f'warm_{at}()' for at in range(len(lines)))}]"])


def _measured(given: str, cache: str) -> tuple[float, float, float]:
    environment = {**os.environ, "NUMBA_CACHE_DIR": cache} if cache else dict(os.environ)
    code = _MEASURED.format(given=given)
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    imported, first, second = (float(word) for word in done.stdout.split())
    return imported, first, second
