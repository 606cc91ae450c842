"""Loops are compiled once and kept, by as many processes as begin at the same time."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mpvi_bt.compiled import compiled, compiled_later

USES = "import numpy as np\nfrom mpvi_bt.robot.linear_algebra import matmul\nprint(matmul(np.eye(3), [1, 2, 3]))"


def test_without_a_folder_for_its_cache_a_loop_is_compiled_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where numba finds no folder to write to, it works as well."""

    def njit(_: Any, **options: bool) -> Callable[..., Any]:
        if options.pop("cache", False):
            raise RuntimeError("cannot cache function: no locator available")
        return lambda function: function

    monkeypatch.setattr("numba.njit", njit)
    assert compiled(lambda a, b: a + b)(1, 2) == compiled_later(lambda a, b: a + b)(1, 2) == 3


def test_processes_that_compile_at_the_same_time_leave_what_later_ones_can_load(tmp_path: Path) -> None:
    """Four begin with an empty cache, and one more loads what they left: a kept ufunc of numba's crashed here."""
    start = [sys.executable, "-c", USES]
    env = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    together = [subprocess.Popen(start, env=env, stdout=subprocess.PIPE) for _ in range(4)]
    said = [process.communicate()[0] for process in together]
    said.append(subprocess.run(start, env=env, stdout=subprocess.PIPE).stdout)
    assert said == [b"[1. 2. 3.]\n"] * 5
    assert list(tmp_path.rglob("*.nbi"))
