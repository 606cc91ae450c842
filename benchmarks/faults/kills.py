"""`python -m benchmarks.faults.kills`: a suite of short mixed episodes, killed at random moments again and again.

After each kill every result that is there has to be whole, untouched since it was written, and the one that an
undisturbed run gives; the suite then goes on, and begins anew in another folder once it is done.
"""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from benchmarks.faults.trials import Outcome, drawn, one_line, options, play
from mpvi_bt.ground.errors import UserError
from mpvi_bt.runs.choices.config import EPISODE
from mpvi_bt.runs.episode.result import read_result
from tests.suite_runs import alive as is_alive

ROOT = Path(__file__).parents[2]
SUITE = """\
about: Short episodes of two methods.
methods: [expert, mpvi]
tasks: [picking_up_trash, tidying_bedroom, bringing_water]
instances: [0, 1]
"""
TREE = "tree: short\nroot:\n  timeout: 2\n  child: {manipulate: pick up a can of soda with the right hand}\n"
WAYS = {  # and how often of twenty
    "SIGKILL of the suite": 7,
    "SIGKILL of all at once": 5,
    "SIGKILL of a worker": 3,
    "SIGINT": 3,
    "SIGTERM": 2,
}
END_S = 60.0  # for a process that was told to end; loaded machines included
WHOLE_S = 1800.0  # for a whole suite
LATEST_S = 8.0  # after the start of the suite, or after its last result


class Kills:
    """Trials of a suite in a folder.

    Args:
        seed: Of the moments.
        folder: Of all runs; `reference` is the one that nobody disturbs.
        count: Kills in all: after the last one the suite goes on to its end.
        workers: Of the suite.
        suite, tree: Texts of the files.
        episode: "module:function" that plays an episode.
    """

    def __init__(
        self, seed: int, folder: Path, count: int, workers: int = 1, suite: str = SUITE, tree: str = TREE,
        episode: str = EPISODE,
    ) -> None:  # fmt: skip
        self._seed, self._folder, self._count = seed, folder, count
        self._command = [
            sys.executable,
            "-m",
            "mpvi_bt.apps.cli",
            "suite",
            "run",
            "mixed.yaml",
            "--workers",
            str(workers),
        ]
        self._command += ["--episode", episode, *(["--tree", "short.yaml"] if tree else [])]
        folder.mkdir(parents=True, exist_ok=True)
        folder.joinpath("mixed.yaml").write_text(suite)
        folder.joinpath("short.yaml").write_text(tree)
        self._round = max(0, len(list(folder.glob("round*"))) - 1)
        self._run: subprocess.Popen[bytes] | None = None
        self._kept: dict[Path, tuple[int, int]] = {}
        self._due: dict[str, Any] = {}

    @property
    def _out(self) -> Path:
        return self._folder / f"round{self._round}"

    def due(self) -> dict[str, Any]:
        """What the results of an undisturbed run say, by their place."""
        if not self._due:
            reference = self._folder / "reference"
            code = self._begin(reference).wait(WHOLE_S)
            self._run = None
            if code != 0:
                raise UserError(f"the undisturbed suite ends with {code}: {self._said()}")
            self._due = dict(results(reference))
        return self._due

    def __call__(self, number: int) -> Outcome:
        """One kill, and what is there afterwards; after the last one all of it."""
        draw = drawn(self._seed, number)
        self.due()
        way = draw.choices(list(WAYS), list(WAYS.values()))[0]
        run = self._run or self._begin(self._out)
        if draw.random() < 0.5:
            self._await_one_more(run)
        with contextlib.suppress(subprocess.TimeoutExpired):
            run.wait(draw.uniform(0.0, LATEST_S))
        if run.returncode is not None:  # it was done before
            if wrong := self._finished():
                return Outcome(way, *wrong)
            return self(number)
        try:
            wrong = self._killed(run, way, draw) or self.look()
        except subprocess.TimeoutExpired:
            os.killpg(run.pid, signal.SIGKILL)
            self._run = None
            return Outcome(way, "hung", f"it goes on for {END_S:.0f} s after {way}")
        told = f"{len(self._kept)} results of {len(self._due)}"
        if not wrong and number == self._count - 1:
            wrong, told = self._to_the_end(), "and went on to its end"
        return Outcome(way, *wrong) if wrong else Outcome(way, "went on", told)

    def stop(self) -> None:
        """Kill the suite that is at work, if there is one."""
        if self._run is not None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._run.pid, signal.SIGKILL)
            self._run = None

    def look(self) -> tuple[Any, str] | None:
        """What is wrong with the results that are there."""
        for path, stamp in self._kept.items():
            if not path.exists():
                return "lost", f"{path} is gone"
            if stamp != (now := _stamp(path)):
                return "lost", f"{path} was written a second time ({stamp}, {now})"
        for path in sorted(self._out.glob("*/json/[!.]*.json")):
            if read_result(path) is None:
                return "lost", f"{path} is no whole result"
            self._kept.setdefault(path, _stamp(path))
        for place, found in results(self._out):
            if found != self._due.get(place):
                return "misread", f"{self._out / place} is another result than that of an undisturbed run"
        return None

    def _begin(self, out: Path) -> subprocess.Popen[bytes]:
        self._run = subprocess.Popen(
            [*self._command, "--out", str(out)],
            cwd=self._folder,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdout=subprocess.DEVNULL,
            stderr=self._log.open("wb"),
            start_new_session=True,
        )
        return self._run

    @property
    def _log(self) -> Path:
        return self._folder / "said.txt"

    def _said(self) -> str:
        return one_line(self._log.read_text(encoding="utf-8", errors="replace")[-600:])

    def _await_one_more(self, run: subprocess.Popen[bytes]) -> None:
        """Until the suite has a result more, or has ended."""
        before, until = len(list(results(self._out))), time.monotonic() + END_S
        while run.poll() is None and len(list(results(self._out))) == before and time.monotonic() < until:
            time.sleep(0.1)

    def _killed(self, run: subprocess.Popen[bytes], way: str, draw: random.Random) -> tuple[Any, str] | None:
        """Kill it, and wait until it is gone; what is wrong with how it ends."""
        if way == "SIGKILL of a worker":
            if found := workers(run.pid):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(draw.choice(found), signal.SIGKILL)
            return None
        family = workers(run.pid)
        if way == "SIGKILL of all at once":
            os.killpg(run.pid, signal.SIGKILL)
        else:
            sent = {"SIGINT": signal.SIGINT, "SIGTERM": signal.SIGTERM}.get(way, signal.SIGKILL)
            run.send_signal(sent)
        run.wait(END_S)
        self._run = None
        until = time.monotonic() + END_S
        while alive := [pid for pid in family if is_alive(pid)]:
            if time.monotonic() > until:
                os.killpg(run.pid, signal.SIGKILL)
                return "hung", f"workers {alive} live on"
            time.sleep(0.05)
        said = self._log.read_text(encoding="utf-8", errors="replace")
        return ("crashed", one_line(said[-300:])) if "Traceback (most recent call last)" in said else None

    def _finished(self) -> tuple[Any, str] | None:
        """What is wrong with a suite that has ended by itself; if nothing is, the next round begins."""
        assert self._run is not None
        code, self._run = self._run.returncode, None
        if code == 3:  # an episode whose worker was killed twice is left to the next run
            return self.look()
        if code != 0:
            return "crashed", f"it ends with {code}: {self._said()}"
        if wrong := self.look():
            return wrong
        if missing := self._due.keys() - dict(results(self._out)).keys():
            return "lost", f"{len(missing)} results are missing, such as {sorted(missing)[0]}"
        self._round, self._kept = self._round + 1, {}
        return None

    def _to_the_end(self) -> tuple[Any, str] | None:
        last = self._round
        while self._round == last:
            try:
                (self._run or self._begin(self._out)).wait(WHOLE_S)
            except subprocess.TimeoutExpired:
                return "hung", "the suite does not end"
            if wrong := self._finished():
                return wrong
        return None


def results(out: Path) -> Iterator[tuple[str, Any]]:
    """Place of each whole result of a suite, and what it says but for wall times."""
    for path in sorted(out.glob("*/json/[!.]*.json")):
        found = read_result(path)
        if found is not None:
            data = found.model_dump(mode="json", exclude={"wall"})
            yield path.relative_to(out).as_posix(), data


def _stamp(path: Path) -> tuple[int, int]:
    told = path.stat()
    return told.st_ino, told.st_mtime_ns


def workers(pid: int) -> list[int]:
    """The worker processes of a suite."""
    found = []
    with contextlib.suppress(OSError):
        for thread in Path(f"/proc/{pid}/task").iterdir():
            for child in (thread / "children").read_text().split():
                with contextlib.suppress(OSError):
                    if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
                        found.append(int(child))
    return found


@click.command()
@options(100, "kills")
@click.option("--workers", "-j", "count_workers", type=click.IntRange(1, 16), default=1, show_default=True)
def main(seed: int, count: int, out: Path, only: int | None, count_workers: int) -> None:
    """Kill a suite again and again, and say what came of it."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell has its background jobs ignore it, and theirs
    kills = Kills(seed, out.with_suffix(f".{seed}").resolve(), count, count_workers)
    try:
        play(kills, seed, count, out, only, "kills")
    finally:
        kills.stop()


if __name__ == "__main__":
    main()
