"""The folder of a suite's results: one file an episode, so a killed run can continue.

- manifest.json: what the results are of, so that no others are mixed in (manifest.py)
- asked.json: calls and tokens that language models were asked for, if any were
- quarantine/: what was to be a result and is none

and in a folder for each method of the suite, or beside these where it names none:

- json/{task}_{instance}_{seed}.json: the result, written whole or not at all
- faults/{task}_{instance}_{seed}.json: what broke, for episodes that the machine could not finish
- traces/, for `mpvi explain` and its like, unless they were not wanted; videos/, pictures/ and mcap/, if asked for
- plans/: those that a language model made, or its last answer where it made none
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import tempfile
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.writing import unwritable
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.result import Result, read_result, write_json, write_result

RUNS = Path("runs")  # below it each suite has a folder of its name, where no other is asked for
_LOCK_TRIES, _LOCK_WAIT_S = 10, 0.05
_UNDONE = ("interrupted", "backend_error")  # ends of which the episode has to be run again


@dataclass(frozen=True)
class Fault:
    """Broken machinery: never a task failure.

    Attributes:
        message: One line.
        backend: Reason code, such as "server_closed", if a policy's server or a language model failed; else "".
        details: The traceback, if there was one.
        hopeless: Every other episode would break alike, such as a name that is unknown.
        exit_code: What the command line ends with for it.
    """

    message: str
    details: str = ""
    hopeless: bool = False
    exit_code: int = 3
    backend: str = ""

    @property
    def kind(self) -> str:
        """What failed, for a person."""
        return "backend failure" if self.backend else "machine fault"


@dataclass(frozen=True)
class Store:
    """The results of one suite.

    Attributes:
        out: Its folder; made when first written to.
    """

    out: Path

    def folder(self, config: EpisodeConfig) -> Path:
        """The folder of all files of an episode."""
        return self.out / (config.method or "")

    def path(self, config: EpisodeConfig) -> Path:
        """The episode's result file."""
        return self.folder(config) / "json" / f"{config.name}.json"

    def result(self, config: EpisodeConfig) -> Result | None:
        """The episode's result; None if it is missing, cut short, of something else, or of an end to be run again.

        Raises:
            UserError: It is the same episode's under another configuration, which must not be mixed with this one.
        """
        result = self._whole(config)
        if result is None or result.ended in _UNDONE:
            return None
        wanted = config.record()
        other = {k: v for k, v in result.config.items() if wanted.get(k) != v}
        if other or wanted.keys() != result.config.keys():
            was = ", ".join(f"{k} {v}" for k, v in other.items()) or "other settings"
            raise UserError(f"{self.path(config)}: a result of another configuration ({was}); choose another --out")
        return result

    def quarantine(self, config: EpisodeConfig) -> Path | None:
        """Move an invalid result file of the episode aside. Returns its new path; None if there was nothing to move.

        Raises:
            UserError: It cannot be moved.
        """
        path = self.path(config)
        if self._whole(config) is not None or not path.exists():
            return None
        folder = self.out / "quarantine" / (config.method or "")
        moved = folder / path.name
        try:
            folder.mkdir(parents=True, exist_ok=True)
            number = 1
            while moved.exists():
                number += 1
                moved = folder / f"{path.stem}.{number}.json"
            path.rename(moved)
        except OSError as error:
            raise unwritable(moved, error) from None
        return moved

    def _whole(self, config: EpisodeConfig) -> Result | None:
        """The episode's result from its file, if task, instance and seed fit."""
        result = read_result(self.path(config))
        due = (config.task_name, config.instance, config.seed)
        return result if result and (result.task, result.instance_id, result.rollout_id) == due else None

    def write(self, config: EpisodeConfig, result: Result | dict[str, object]) -> None:
        """Write the episode's result and forget its fault."""
        write_result(self.path(config), result)
        self._fault_path(config).unlink(missing_ok=True)

    def fault(self, config: EpisodeConfig) -> Fault | None:
        """What broke the episode in an earlier run, or None."""
        path = self._fault_path(config)
        if not paths.is_file(path):
            return None
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
            return Fault(str(data["message"]), str(data["details"]), backend=str(data.get("backend", "")))
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return None

    def write_fault(self, config: EpisodeConfig, fault: Fault) -> None:
        """Note what broke the episode."""
        data = {"message": fault.message, "details": fault.details, "backend": fault.backend}
        path = self._fault_path(config)
        if not paths.is_file(path):
            path.unlink(missing_ok=True)  # a pipe, say, which would be written to
        write_json(path, data)

    @contextlib.contextmanager
    def locked(self, episodes: Iterable[EpisodeConfig] = ()) -> Iterator[None]:
        """Keep a second run out of the folder; the lock ends with the process, however it ends.

        Args:
            episodes: Whose results are to be written: that they can be is tried now, not when an episode's work is
                lost.

        Raises:
            UserError: Another run is at work in it, or the folder cannot be written.
            DiskFull: There is no room.
        """
        try:
            self.out.mkdir(parents=True, exist_ok=True)
            handle = os.open(self.out / ".lock", os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise unwritable(self.out, error) from None
        try:
            self._lock(handle)
            for folder in {self.folder(config) / kind for config in episodes for kind in ("json", "faults")}:
                _try(folder)
            self._sweep()
            yield
        finally:
            os.close(handle)

    def _lock(self, handle: int) -> None:
        for _ in range(_LOCK_TRIES):  # `running` of another process holds it for a moment
            with contextlib.suppress(BlockingIOError):
                return fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            time.sleep(_LOCK_WAIT_S)
        raise UserError(f"{self.out}: another `mpvi suite run` is at work in this folder")

    def running(self) -> bool:
        """Whether a run is at work in the folder now."""
        try:
            handle = os.open(self.out / ".lock", os.O_RDWR)
        except OSError:
            return False
        try:
            fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        finally:
            os.close(handle)
        return False

    def _fault_path(self, config: EpisodeConfig) -> Path:
        return self.folder(config) / "faults" / f"{config.name}.json"

    def _sweep(self) -> None:
        """Remove what a killed run left half-written."""
        for pattern in ("json/.*.tmp", "faults/.*.tmp", ".*.tmp"):
            for leftover in (*self.out.glob(pattern), *self.out.glob(f"*/{pattern}")):
                leftover.unlink(missing_ok=True)


def _try(folder: Path) -> None:
    """Make a folder, lasting, and see that a file can be written in it. Raises as `writing.unwritable` says."""
    try:
        made = not folder.exists()
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(bytes(4096))
        if made:
            for above in (folder.parent, folder.parent.parent):
                handle = os.open(above, os.O_RDONLY)
                try:
                    os.fsync(handle)
                finally:
                    os.close(handle)
    except OSError as error:
        raise unwritable(folder, error) from None
