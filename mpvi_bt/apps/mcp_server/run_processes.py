"""The runs of a server: one at a time, each a process of its own, with a folder of its own."""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from mpvi_bt.apps.mcp_server.answers import RunProgress
from mpvi_bt.executive.drawing.endings import ended, is_plan
from mpvi_bt.executive.trace.growing_trace import Follow
from mpvi_bt.executive.trace.html import PageFrames
from mpvi_bt.ground.errors import MpviError, UnknownName, UserError

_STOP_S = 30.0  # for a run to be saved and its goal to be scored, before it is killed
_LATEST = 8


@dataclass
class RunProcess:
    """One run.

    Attributes:
        id: Such as "3".
        about: Whose and what, for whoever is refused.
        dry: Whether nothing moved.
        folder: Of its tree, trace, result, and what it said.
        process: That runs it.
        began: Wall time, monotonic.
    """

    id: str
    about: str
    dry: bool
    folder: Path
    process: subprocess.Popen[bytes]
    began: float
    _follow: Follow | None = None
    _frames: PageFrames | None = None
    _gave_up: int = 0
    _states: dict[str, str] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def alive(self) -> bool:
        """Whether it goes on."""
        return self.process.poll() is None

    @property
    def trace(self) -> Path | None:
        """Its trace, once there is one."""
        return next(iter(self.folder.glob("*.trace.jsonl")), None)

    def progress(self) -> RunProgress:
        """How far it is."""
        with self._lock:
            alive = self.alive
            self._read()
            follow, frames = self._follow, self._frames
            if follow is None or frames is None:
                outcome = "" if alive else f"it did not begin: {self.said()}"
                return _told(self.id, "starting" if alive else "ended", outcome=outcome)
            last: dict[str, Any] = frames.frames[-1] if frames.frames else {"tick": 0, "time": 0.0}
            end, outcome = follow.end, ""
            if end is not None:
                outcome = ended(end.ending, self._gave_up, is_plan(follow.tree), end.time_s, end.q)
            elif not alive:
                outcome = f"it broke off: {self.said()}"
            leaves = {node["path"] for node in frames.trees[-1] if node["family"] == "leaf"}
            said = [(frame["time"], one) for frame in frames.frames for one in frame.get("said", ())]
            return _told(
                self.id,
                "running" if alive else "ended",
                tick=end.tick if end else last["tick"],
                time_s=end.time_s if end else last["time"],
                doing=[path for path, status in self._states.items() if status == "RUNNING" and path in leaves],
                latest=[f"{time_s:.1f} s: {one['text']}" for time_s, one in said[-_LATEST:]],
                outcome=outcome,
            )

    def _read(self) -> None:
        """Take in what the trace has more."""
        with contextlib.suppress(MpviError):
            if self._follow is None and self.trace is not None:
                self._follow = Follow(self.trace)
                self._frames = PageFrames(self._follow.tree)
            if self._follow is not None and self._frames is not None:
                ticks = self._follow.new()
                self._frames.add(ticks)
                for tick in ticks:
                    self._states |= {path: state.status for path, state in tick.nodes.items()}
                    self._gave_up += sum(state.gave_up for state in tick.nodes.values())

    def said(self) -> str:
        """The last lines that it printed."""
        text = (self.folder / "said.txt").read_text(encoding="utf-8", errors="replace")
        return " ".join(re.sub(r"\s+", " ", text).split()[-80:])


def _told(
    run: str,
    state: Literal["starting", "running", "ended"],
    tick: int = 0,
    time_s: float = 0.0,
    doing: Sequence[str] = (),
    latest: Sequence[str] = (),
    outcome: str = "",
) -> RunProgress:
    return RunProgress(
        run=run, state=state, tick=tick, time_s=time_s, doing=list(doing), latest=list(latest), outcome=outcome
    )


class RunProcesses:
    """All runs; the one that goes on holds the robot.

    Args:
        folder: Below which each has its own.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._runs: dict[str, RunProcess] = {}
        self._numbers = itertools.count(1)
        self._lock = threading.Lock()

    def start(self, words: Sequence[str], about: str, dry: bool, tree: str | None) -> RunProcess:
        """Start `mpvi run WORDS`.

        Args:
            words: Of the command line.
            about: Whose run this is, and what.
            dry: Whether nothing moves.
            tree: Text of the tree to run, or None.

        Raises:
            UserError: Another run holds the robot.
        """
        with self._lock:
            if (held := next((run for run in self._runs.values() if run.alive), None)) is not None:
                since = time.monotonic() - held.began
                raise UserError(
                    f"run {held.id} ({held.about}) holds the robot, since {since:.0f} s: "
                    f"wait for its end with progress, or end it with stop"
                )
            folder = self._new_folder()
            more: list[str] = []
            if tree is not None:
                file = folder / "tree.yaml"
                file.write_text(tree, encoding="utf-8")
                more = ["--tree", str(file)]
            command = [sys.executable, "-c", "from mpvi_bt.apps.cli import main; main()", "run", *words, *more]
            with (folder / "said.txt").open("wb") as said:
                process = subprocess.Popen(
                    [*command, "--no-watch", "--out", str(folder)],
                    stdin=subprocess.DEVNULL,
                    stdout=said,
                    stderr=said,
                    start_new_session=True,  # Ctrl-C is for the server, which stops it
                )
            run = RunProcess(folder.name, about, dry, folder, process, time.monotonic())
            self._runs[run.id] = run
            return run

    def _new_folder(self) -> Path:
        for number in self._numbers:  # of an earlier server some are there already
            folder = self._folder / str(number)
            with contextlib.suppress(FileExistsError):
                folder.mkdir(parents=True)
                return folder
        raise AssertionError

    def get(self, name: str) -> RunProcess:
        """The run of an id. Raises UnknownName."""
        if name not in self._runs:
            raise UnknownName("run", name, self._runs)
        return self._runs[name]

    @property
    def last(self) -> RunProcess:
        """The one that was started last. Raises UserError if none was."""
        if not self._runs:
            raise UserError("nothing has been run yet")
        return next(reversed(self._runs.values()))

    def stop(self, run: RunProcess) -> None:
        """End it as Ctrl-C does, and wait; what does not end is killed."""
        if run.alive:
            with contextlib.suppress(ProcessLookupError):
                run.process.send_signal(signal.SIGINT)
            try:
                run.process.wait(_STOP_S)
            except subprocess.TimeoutExpired:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(run.process.pid, signal.SIGKILL)
                run.process.wait()

    def close(self) -> None:
        """End all."""
        for run in self._runs.values():
            self.stop(run)
