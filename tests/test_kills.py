"""Suites that are killed again and again, at whatever moment: no episode lost, none twice, every file valid."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import time
from collections import Counter
from pathlib import Path

import pytest

from mpvi_bt.runs.episode.result import read_result
from mpvi_bt.runs.suite.store import Store
from mpvi_bt.runs.suite.suites import load_suite
from tests.fake_episodes import fake_result
from tests.suite_runs import EPISODES, launch, running, started, wait_until

KILLS = ["worker"] * 8 + ["suite"] * 6 + ["machine"] * 6
SUITE = "tasks: [picking_up_trash]\ninstances: [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]\nseeds: [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]\n"


class PowerCut(BaseException):
    """The machine stops."""


def workers(run: subprocess.Popen[str]) -> list[int]:
    """The worker processes of a suite, those that are still starting too; waits for one."""
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and run.poll() is None:
        with contextlib.suppress(OSError):  # one of them has just ended
            threads = Path(f"/proc/{run.pid}/task").iterdir()
            children = [child for thread in threads for child in (thread / "children").read_text().split()]
            found = [int(c) for c in children if b"spawn_main" in Path(f"/proc/{c}/cmdline").read_bytes()]
            if found:
                return found
        time.sleep(0.02)
    raise AssertionError("the suite has no workers")


@pytest.mark.rare
@pytest.mark.slow
@pytest.mark.parametrize("seed", [0])
def test_twenty_kills_cost_nothing(tmp_path: Path, log: Path, seed: int) -> None:
    """Of a worker, of the suite, of all at once with what was not synced; then the suite goes on to its end.

    No result is ever written a second time, and no episode begins again that has one.
    """
    draw = random.Random(seed)
    suite, out = tmp_path / "hundred.yaml", tmp_path / "out"
    suite.write_text(SUITE)
    episodes = load_suite(str(suite)).episodes()
    kills = draw.sample(KILLS, len(KILLS))
    kept: dict[Path, tuple[int, int]] = {}
    begun: Counter[str] = Counter()

    def look() -> None:
        """Every file is valid, and what was there is untouched and was not played again."""
        now = started(log)
        assert all(now[path.stem] == begun[path.stem] for path in kept)
        assert all((path.stat().st_ino, path.stat().st_mtime_ns) == stamp for path, stamp in kept.items())
        for path in (out / "json").glob("[!.]*"):
            assert read_result(path) is not None, path
            kept.setdefault(path, (path.stat().st_ino, path.stat().st_mtime_ns))
        begun.update(now - begun)

    run = launch(out, log, suite=str(suite), FAKE_SLEEP="0.4")
    for what in kills:
        if run.poll() is not None:
            run = launch(out, log, suite=str(suite), FAKE_SLEEP="0.4")
        if draw.random() < 0.7:  # at work; else while it starts, or soon after the kill before
            before = started(log).total()
            wait_until(lambda before=before: started(log).total() > before)  # type: ignore[misc]
        time.sleep(draw.uniform(0.0, 1.0))
        if what == "worker":
            os.kill(draw.choice(workers(run)), signal.SIGKILL)
            continue
        assert run.poll() is None, "the suite has ended before the kills have: it needs more episodes"
        if what == "suite":
            run.kill()
        else:
            os.killpg(run.pid, signal.SIGKILL)
        run.communicate()
        wait_until(lambda: not running(log), seconds=20)
        if what == "machine":
            for path in out.rglob(".*.tmp"):  # what was not synced is lost in part
                os.truncate(path, draw.randrange(path.stat().st_size + 1))
        look()
    for _ in range(3):  # an episode whose workers were killed twice is left to the next run
        _, said = run.communicate(timeout=300)
        look()
        if run.returncode == 0:
            break
        run = launch(out, log, suite=str(suite))
    assert run.returncode == 0, said
    assert {path.stem for path in kept} == {config.name for config in episodes}
    assert all(Store(out).result(config) is not None for config in episodes)
    due = {f"json/{config.name}.json" for config in episodes} | {f"traces/{config.name}.jsonl" for config in episodes}
    left = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    assert left == due | {".lock", "manifest.json"}


@pytest.mark.parametrize("synced", range(4))
@pytest.mark.parametrize("renamed", [False, True])
def test_a_power_cut_leaves_a_result_whole_or_not_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, synced: int, renamed: bool
) -> None:
    """Whatever was synced by then, and whether or not a rename that was not is found on the disk afterwards."""
    store, config = Store(tmp_path / "out"), EPISODES[0]
    store.write(EPISODES[1], fake_result(EPISODES[1]))
    safe: set[int] = set()  # inodes whose content is on the disk
    moves: list[tuple[Path, Path]] = []  # that are not
    steps = iter(range(100))
    fsync, replace = os.fsync, Path.replace

    def step() -> None:
        if next(steps) == synced:
            raise PowerCut

    def sync(handle: int) -> None:
        step()
        safe.add(os.fstat(handle).st_ino)
        if os.path.isdir(f"/proc/self/fd/{handle}"):  # noqa: PTH112 (a link of the system's own)
            moves.clear()
        fsync(handle)

    def move(source: Path, target: Path) -> Path:
        step()
        moves.append((source, target))
        return replace(source, target)

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", sync)
        patched.setattr(Path, "replace", move)
        patched.setattr(Path, "unlink", lambda *_, **__: None)  # nobody is there to tidy up
        try:
            store.write(config, fake_result(config))
        except PowerCut:
            done = False
        else:
            done = True
    for source, target in moves if not renamed else ():
        target.rename(source)
    for path in (store.out / "json").iterdir():
        if path.stat().st_ino not in safe and path != store.path(EPISODES[1]):
            os.truncate(path, path.stat().st_size // 2)
    assert done == (synced == 3), "three steps: content, name, folder"
    found = store.result(config)
    assert found is not None or not store.path(config).exists()
    assert found is not None or not done, "what was said to be written is"
    assert store.result(EPISODES[1]) is not None
    with store.locked():
        store.write(config, fake_result(config))
    assert sorted(path.name for path in (store.out / "json").iterdir()) == sorted(
        f"{c.name}.json" for c in EPISODES[:2]
    )
