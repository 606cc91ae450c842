"""The folder of a suite's results: one file an episode, so that a killed run goes on where it stopped.

- json/{task}_{instance}_{seed}.json: the result, written whole or not at all
- faults/{task}_{instance}_{seed}.json: what broke, for episodes that the machine could not finish
- traces/, for `mpvi explain` and its like, unless they were not wanted; videos/ and pictures/, if asked for
- asked.json: calls and tokens that language models were asked for, if any were
- plans/: those that a language model made, or its last answer where it made none
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mpvi_bt.errors import UserError
from mpvi_bt.suite.config import EpisodeConfig
from mpvi_bt.suite.result import Result, read_result, write_json, write_result

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

    def path(self, config: EpisodeConfig) -> Path:
        """The episode's result file."""
        return self.out / "json" / f"{config.name}.json"

    def result(self, config: EpisodeConfig) -> Result | None:
        """The episode's result; None if it is missing, cut short, of something else, or of an end to be run again.

        Raises:
            UserError: It is the same episode's under another configuration, which must not be mixed with this one.
        """
        result = read_result(self.path(config))
        if (
            result is None
            or result.ended in _UNDONE
            or (result.task, result.instance_id, result.rollout_id)
            != (
                config.task_name,
                config.instance,
                config.seed,
            )
        ):
            return None
        wanted = config.record()
        other = {k: v for k, v in result.config.items() if wanted.get(k) != v}
        if other or wanted.keys() != result.config.keys():
            was = ", ".join(f"{k} {v}" for k, v in other.items()) or "other settings"
            raise UserError(f"{self.path(config)}: a result of another configuration ({was}); choose another --out")
        return result

    def write(self, config: EpisodeConfig, result: Result | dict[str, object]) -> None:
        """Write the episode's result and forget its fault."""
        write_result(self.path(config), result)
        self._fault_path(config).unlink(missing_ok=True)

    def fault(self, config: EpisodeConfig) -> Fault | None:
        """What broke the episode in an earlier run, or None."""
        try:
            data = json.loads(self._fault_path(config).read_text(encoding="utf-8"))
            return Fault(str(data["message"]), str(data["details"]), backend=str(data.get("backend", "")))
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def write_fault(self, config: EpisodeConfig, fault: Fault) -> None:
        """Note what broke the episode."""
        data = {"message": fault.message, "details": fault.details, "backend": fault.backend}
        write_json(self._fault_path(config), data)

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Keep a second run out of the folder; the lock ends with the process, however it ends.

        Raises:
            UserError: Another run is at work in it, or the folder cannot be written.
        """
        try:
            self.out.mkdir(parents=True, exist_ok=True)
            handle = os.open(self.out / ".lock", os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise UserError(f"{self.out}: {(error.strerror or 'cannot be written').lower()}") from None
        try:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise UserError(f"{self.out}: another `mpvi suite run` is at work in this folder") from None
            self._sweep()
            yield
        finally:
            os.close(handle)

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
        return self.out / "faults" / f"{config.name}.json"

    def _sweep(self) -> None:
        """Remove what a killed run left half-written."""
        for folder in ("json", "faults"):
            for leftover in (self.out / folder).glob(".*.tmp"):
                leftover.unlink(missing_ok=True)
