"""Plays episodes on a Ray cluster; the only module that knows Ray. Needs the extra `ray`.

No folder is shared: what an episode writes on its node comes back with its result, and is written here.
"""

from __future__ import annotations

import contextlib
import importlib.util
import logging
import os
import signal
import socket
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mpvi_bt.ground.errors import BackendError, UserError
from mpvi_bt.ground.extras import install
from mpvi_bt.ground.writing import unwritable
from mpvi_bt.runs.choices.config import EPISODE, OUTPUTS, EpisodeConfig
from mpvi_bt.runs.suite.manifest import Manifest, make_manifest
from mpvi_bt.runs.suite.processes import WALL_LIMIT_S
from mpvi_bt.runs.suite.store import Fault
from mpvi_bt.runs.suite.worker import EPISODES_A_PROCESS, THREAD_LIMITS, Played, play

_COUNT_S = 2.0  # how often the cluster is asked for its size
_KNOCK_S = 10.0
_SETTINGS = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_worker_niceness": "0",  # of a cluster of our own; Ray's 15 starves it where the cores have other work
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",  # a detector may use the node's GPU without one being reserved
}
_STORE_BYTES = 256 << 20  # shared memory of a cluster of our own: results and films pass through it


@dataclass(frozen=True)
class Sent:
    """What comes back from a node.

    Attributes:
        played: What came of the episode.
        files: Content of each file that it wrote, by output of `EpisodeConfig` and path below that one's folder.
    """

    played: Played
    files: Mapping[tuple[str, str], bytes]


class RayEngine:
    """As `runner.Engine`, on the nodes of a cluster.

    Args:
        address: Of the cluster, such as "auto" or "host:6379"; None: RAY_ADDRESS, or else one is started here.
        workers: Episodes at work at once at most; None: one a core of the cluster, as it grows and shrinks.
        function: "module:name" of the function that plays one episode.
        wall_limit_s: Wall time after which an episode counts as hung and its process is ended.
        manifest: What the episodes are of: a node that has other data or another version is refused.

    Raises:
        UserError: Ray is not installed.
    """

    def __init__(
        self,
        address: str | None = None,
        workers: int | None = None,
        function: str = EPISODE,
        wall_limit_s: float = WALL_LIMIT_S,
        manifest: Manifest | None = None,
    ) -> None:
        if importlib.util.find_spec("ray") is None:
            raise UserError(f"--engine ray needs Ray, which is not installed: {install('ray')}")
        self._address = address or os.environ.get("RAY_ADDRESS")
        self._asked, self._function, self._wall_limit_s, self._manifest = workers, function, wall_limit_s, manifest
        self._busy: dict[Any, tuple[EpisodeConfig, float]] = {}
        self._cores, self._counted = 0, -_COUNT_S

    @property
    def workers(self) -> int:
        """As many as were asked for, and no more than the cluster has cores; 0 before it is known."""
        import ray

        if ray.is_initialized() and time.monotonic() - self._counted >= _COUNT_S:
            self._cores, self._counted = int(ray.cluster_resources().get("CPU", 0)), time.monotonic()
        return min(self._asked or self._cores, self._cores)

    def open(self) -> None:
        """Join the cluster, or start one. Raises BackendError if there is none at the address."""
        import ray

        self._knock()
        for name, value in _SETTINGS.items():
            os.environ.setdefault(name, value)
        own = {"num_cpus": self._asked, "include_dashboard": False, "object_store_memory": _STORE_BYTES}
        try:
            ray.init(
                self._address or "local",
                **({} if self._address else own),
                log_to_driver=False,
                logging_level=logging.ERROR,
                runtime_env={"env_vars": dict.fromkeys(THREAD_LIMITS, "1") | _SETTINGS},
            )
        except Exception as error:  # what it raises depends on what is there
            where = f"no Ray cluster at {self._address}" if self._address else "Ray cannot start here"
            raise BackendError(f"{where}: {_line(error)}") from error
        self._play = ray.remote(num_cpus=1, max_retries=0, max_calls=EPISODES_A_PROCESS, scheduling_strategy="SPREAD")(
            play_far
        )

    def _knock(self) -> None:
        """Raise BackendError if nobody is at the address: Ray itself asks for minutes."""
        host, _, port = (self._address or "").rpartition("/")[2].rpartition(":")
        if host and port.isdecimal():
            try:
                socket.create_connection((host, int(port)), timeout=_KNOCK_S).close()
            except (OSError, OverflowError) as error:
                raise BackendError(f"no Ray cluster at {self._address}: {_line(error)}") from None

    def start(self, config: EpisodeConfig) -> None:
        """Hand an episode to the cluster."""
        # The ledger of what language models may cost is a file of this machine.
        far = replace(config, suite_budget=None) if self._address else config
        due = self._manifest if self._address else None
        reference = self._play.remote(self._function, far, self._wall_limit_s, str(Path.cwd()), due)
        self._busy[reference] = (config, time.monotonic())

    def wait(self, seconds: float) -> Iterator[tuple[EpisodeConfig, Played]]:
        """Episodes that ended, as soon as one has; their files are here then. Raises as `writing.unwritable` says."""
        import ray

        done, _ = ray.wait(list(self._busy), num_returns=1, timeout=seconds)
        for reference in done:
            config, began = self._busy.pop(reference)
            try:
                sent = ray.get(reference)
            except ray.exceptions.RayTaskError as error:  # what an episode raises comes as a fault, so it never began
                said = _line(error.cause if isinstance(error.cause, BaseException) else error)
                raise BackendError(
                    f"a node of the cluster cannot play episodes: {said}; every node needs this version of mpvi_bt"
                ) from None
            except ray.exceptions.RayError as error:
                late = time.monotonic() - began >= self._wall_limit_s
                said = f"no result within {self._wall_limit_s:g} s of wall time" if late else _line(error)
                yield config, Played(fault=Fault(said))
                continue
            _keep(config, sent.files)
            yield config, sent.played

    def close(self) -> None:
        """Leave the cluster, and so end our running episodes; stop a cluster of our own."""
        import ray

        ray.shutdown()


def play_far(
    function: str, config: EpisodeConfig, wall_limit_s: float, folder: str, due: Manifest | None = None
) -> Sent:
    """Play an episode on a node, its files in a folder of its own that is gone afterwards.

    Args:
        function: As of `worker.play`.
        config: The episode, whose outputs say which files are wanted.
        wall_limit_s: The system ends this process if the episode takes longer.
        folder: Where the suite was started: files are found from there, if the node has it.
        due: What the node must have; None: that is not looked at.
    """
    with contextlib.suppress(OSError):
        os.chdir(folder)
    if due is not None and (wrong := _wrong(due, config)):
        return Sent(Played(fault=Fault(wrong, hopeless=True, exit_code=UserError.exit_code)), {})
    with tempfile.TemporaryDirectory() as own:
        below = {field: Path(own, field) for field in _outputs(config)}
        mine: dict[str, Any] = {field: below[field] / path.name for field, path in _outputs(config).items()}
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_REAL, wall_limit_s)
        try:
            played = play(function, replace(config, **mine))
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
        files = {
            (field, path.relative_to(root).as_posix()): path.read_bytes()
            for field, root in below.items()
            for path in root.rglob("*")
            if path.is_file()
        }
        return Sent(played, files)


def _keep(config: EpisodeConfig, files: Mapping[tuple[str, str], bytes]) -> None:
    """Write files from the episode's node to their chosen paths here."""
    for (field, below), content in files.items():
        path = _outputs(config)[field].parent / below
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        except OSError as error:
            raise unwritable(path, error) from None


def _outputs(config: EpisodeConfig) -> dict[str, Path]:
    return {field: path for field in sorted(OUTPUTS) if isinstance(path := getattr(config, field), Path)}


def _wrong(due: Manifest, config: EpisodeConfig) -> str:
    """Differences between this node's files and the manifest, or ""; checked once a task in each process."""
    if (config.task, config.method) in _looked_at:
        return ""
    node = f"node {socket.gethostname()}"
    try:
        differences = list(due.differences(make_manifest(due.suite, [config])))
    except UserError as error:
        return f"{node}: {error}"
    if differences:
        return f"{node} is not as this machine is: {'; '.join(differences[:4])}"
    _looked_at.add((config.task, config.method))
    return ""


_looked_at: set[tuple[str, str | None]] = set()


def _line(error: BaseException) -> str:
    """The first line of what an error says."""
    return next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)
