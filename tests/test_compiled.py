"""Loops are compiled once and kept, by as many processes as begin at the same time."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mpvi_bt.executive.behaviors.context import Stopwatch
from mpvi_bt.ground.compiled import compiled, compiled_later, compiling
from tests.conftest import Shell

USES = (
    "import numpy as np\nfrom mpvi_bt.ground.geometry.linear_algebra import matmul\nprint(matmul(np.eye(3), [1, 2, 3]))"
)


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


def test_what_compiling_takes_is_told_once_and_is_no_part_of_what_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """An activity that waits for a loop to be compiled takes no longer than one that finds it compiled."""
    said: list[str] = []
    monkeypatch.setattr(compiling, "told", lambda: said.append("compiling"))
    stopwatch, before = Stopwatch(), compiling.seconds
    first, second = (compiled(eval(f"lambda a: a + {k}")) for k in (1, 2))  # two loops that no cache has
    began = time.perf_counter()
    with stopwatch("policy"):
        assert (first(1.5), second(1.5)) == (2.5, 3.5)
    took, waited = time.perf_counter() - began, compiling.seconds - before
    assert waited > 0.01
    assert stopwatch.seconds["policy"] == pytest.approx(took - waited, abs=0.01)
    assert said == ["compiling"]


@pytest.mark.slow
def test_a_first_run_says_that_it_compiles_and_how_long_that_took(mpvi: Shell, tmp_path: Path) -> None:
    """With an empty cache a line says so, and the result tells its share; the next run says nothing of it."""
    (tmp_path / "short.yaml").write_text("tree: short\nroot: {timeout: 1, child: {navigate: radio receiver}}\n")
    command = ["run", "turning_on_radio", "--method", "expert", "--no-watch", "--set", "detector=oracle"]
    command += ["--tree", "short.yaml"]
    first, second = (mpvi(*command, timeout=300, NUMBA_CACHE_DIR=str(tmp_path / "cache")) for _ in range(2))
    assert [run.stderr.count("compiling loops for this machine, once") for run in (first, second)] == [1, 0]
    assert ["compiling" in run.stdout for run in (first, second)] == [True, False]
    wall = json.loads((tmp_path / "runs" / "turning_on_radio_0_0.json").read_text())["wall"]["loop"]
    assert wall["compiling"] == 0.0
