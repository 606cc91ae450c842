"""What worker processes are worth: the same episodes by one and by two of them, one after the other in one run.

    python -m benchmarks.workers
    python -m benchmarks.workers --methods expert,mpvi --tasks picking_up_trash,bringing_water --workers 1,2,4

Prints how much faster more workers are, episodes an hour, processor time, the memory of a worker, and where wall time
goes. Where others use the machine as well, wall time says little: then look at how much less processor time the busiest
worker takes, its start and what workers cost each other included; it is what wall time would be on an idle machine. A
first episode that does not count fills numba's cache. The results of all runs must be the same, wall times apart.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.methods import load_method
from mpvi_bt.runs.episode.result import Result
from mpvi_bt.runs.report.figures import wall_shares
from mpvi_bt.runs.suite.processes import ProcessEngine
from mpvi_bt.runs.suite.progress import SuiteProgress
from mpvi_bt.runs.suite.runner import run_suite
from mpvi_bt.runs.suite.schedule import EpisodeTimes, budgets_s, in_rounds
from mpvi_bt.runs.suite.store import Store

_SAMPLE_S = 0.5


@dataclass
class Watch:
    """Samples the worker processes; the highest of each counts.

    Attributes:
        resident, own: Memory [MiB] of each process: all that it has, and its share of what several use.
        cpu_s: Processor time.
    """

    resident: dict[int, float] = field(default_factory=dict)
    own: dict[int, float] = field(default_factory=dict)
    cpu_s: dict[int, float] = field(default_factory=dict)
    _stop: threading.Event = field(default_factory=threading.Event)

    def __enter__(self) -> Watch:
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._stop.wait(_SAMPLE_S):
            for pid in _workers():
                try:
                    told = Path(f"/proc/{pid}/smaps_rollup").read_text()
                    times = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
                except OSError:  # it has just ended
                    continue
                self.cpu_s[pid] = (int(times[11]) + int(times[12])) / os.sysconf("SC_CLK_TCK")
                for name, highest in (("Rss", self.resident), ("Pss", self.own)):
                    if match := re.search(rf"^{name}:\s+(\d+) kB", told, re.MULTILINE):
                        highest[pid] = max(highest.get(pid, 0.0), int(match[1]) / 1024)


@dataclass(frozen=True)
class Measured:
    """One run: wall and processor time [s], its processes, and results."""

    workers: int
    wall_s: float
    cpu_s: float
    watch: Watch
    results: dict[EpisodeConfig, Result]


def measure(episodes: list[EpisodeConfig], workers: int) -> Measured:
    """Run the episodes anew with that many workers."""
    with tempfile.TemporaryDirectory() as out, Watch() as watch:
        budget_s = budgets_s(episodes)
        progress = SuiteProgress(open(os.devnull, "w"), EpisodeTimes(budget_s))  # noqa: PTH123, SIM115
        began, cpu_s = time.perf_counter(), _children_s()
        outcome = run_suite(
            episodes, Store(Path(out)), ProcessEngine(workers), progress, lambda todo: in_rounds(todo, budget_s)
        )
        wall_s = time.perf_counter() - began
        if outcome.faults:
            raise SystemExit(f"machine faults: {[fault.message for fault in outcome.faults.values()]}")
        return Measured(workers, wall_s, _children_s() - cpu_s, watch, outcome.results)


def main() -> None:
    """Print the comparison."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--methods", default="expert")
    parser.add_argument("--tasks", default="picking_up_trash,putting_shoes_on_rack")
    parser.add_argument("--instances", type=int, default=4, help="of each task")
    parser.add_argument("--workers", default="1,2")
    given = parser.parse_args()
    episodes = [
        EpisodeConfig(task, instance, **load_method(method))
        for method in given.methods.split(",")
        for task in given.tasks.split(",")
        for instance in range(given.instances)
    ]
    measure(episodes[:1], 1)
    runs = [measure(episodes, int(workers)) for workers in given.workers.split(",")]
    print(f"{len(episodes)} episodes, load average {os.getloadavg()[1]:.1f} on {os.cpu_count()} cores")
    print("workers  wall s  episodes/h  CPU s/episode  busiest CPU s  RSS MiB  PSS MiB  faster by wall, by CPU")
    first = runs[0]
    for run in runs:
        n, busiest = len(episodes), max(run.watch.cpu_s.values())
        rss, pss = max(run.watch.resident.values()), max(run.watch.own.values())
        faster = first.wall_s / run.wall_s, max(first.watch.cpu_s.values()) / busiest
        print(
            f"{run.workers:7d}  {run.wall_s:6.0f}  {3600 * n / run.wall_s:10.0f}  {run.cpu_s / n:13.1f}"
            f"  {busiest:13.1f}  {rss:7.0f}  {pss:7.0f}  {faster[0]:14.2f}  {faster[1]:6.2f}"
        )
    for method in given.methods.split(","):
        of = [result for config, result in first.results.items() if config.method == method]
        told = ", ".join(f"{part} {share:.0%}" for part, share in wall_shares(of)[0].items())
        print(f"{method}: mean q {sum(r.q for r in of) / len(of):.2f}; {told}")
    other = [c.name for c in episodes if len({_without_wall(run.results[c]) for run in runs}) > 1]
    print(f"results are NOT THE SAME in all runs: {', '.join(other)}" if other else "results are the same in all runs")
    raise SystemExit(bool(other))


def _without_wall(result: Result) -> str:
    return result.model_dump_json(exclude={"wall"})


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _workers() -> Iterator[int]:
    for thread in Path("/proc/self/task").iterdir():
        try:
            for child in (thread / "children").read_text().split():
                if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
                    yield int(child)
        except OSError:  # it has just ended
            continue


if __name__ == "__main__":
    main()
