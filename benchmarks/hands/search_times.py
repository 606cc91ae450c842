"""What searches take in trials of skills, by kind: how often they are asked, p50, p95, the longest, the ten slowest.

    python -m benchmarks.hands.search_times -p expert,reactive --robot r1 --seeds 40-43 --out searches.jsonl

Seconds are the processor's: other programs change them little. A killed run goes on where it stopped. `--compare FILE`
sets successes and seconds of the same trials beside those of another commit.
"""

from __future__ import annotations

import functools
import itertools
import json
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.hands.__main__ import SEEDS
from benchmarks.hands.rows import Job
from benchmarks.hands.runner import run_job
from benchmarks.hands.scenes import choose
from mpvi_bt.finding.scene.free_space import FreeSpace
from mpvi_bt.finding.scene.seen import Seen
from mpvi_bt.ground.robot import arm_motion
from mpvi_bt.ground.robot.robots import ROBOTS
from mpvi_bt.hands.stance.course import CourseSearch
from mpvi_bt.hands.stance.stance_search import Search

# What is timed, by the name of its row. Times are inclusive: a stance is searched with many paths of the arm.
SEARCHES: dict[str, tuple[Any, str]] = {
    "a stance": (Search, "find"),
    "a way around": (Search, "go_around"),
    "the start of a course": (CourseSearch, "start"),
    "a path of the arm": (arm_motion, "plan"),
    "a level path of the arm": (arm_motion, "plan_level"),
    "the arms while the torso moves": (arm_motion, "swing"),
    "a field of obstacles": (FreeSpace, "obstacles"),
    "a look: what pictures show": (Seen, "see"),
}
_SLOWEST = 10


@contextmanager
def timed(log: list[tuple[str, float, bool]]) -> Iterator[None]:
    """While this lasts, each search adds its kind, its processor time [s] and whether it found something to `log`."""

    def watched(kind: str, search: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(search)
        def run(*args: Any, **kwargs: Any) -> Any:
            began = time.process_time()
            found = search(*args, **kwargs)
            log.append((kind, time.process_time() - began, found is not None))
            return found

        return run

    whole = {kind: getattr(owner, name) for kind, (owner, name) in SEARCHES.items()}
    for kind, (owner, name) in SEARCHES.items():
        setattr(owner, name, watched(kind, whole[kind]))
    try:
        yield
    finally:
        for kind, (owner, name) in SEARCHES.items():
            setattr(owner, name, whole[kind])


def rows_of(path: Path) -> list[dict[str, Any]]:
    """The trials of a file, one JSON object a line."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def played(job: Job) -> dict[str, Any]:
    """One trial and its searches, as a row."""
    log: list[tuple[str, float, bool]] = []
    with timed(log):
        row = run_job(job)
    searches = [[kind, round(seconds, 5), found] for kind, seconds, found in log]
    name = f"{job.skill}/{job.case} {job.policy} {job.robot} {job.seed}"
    return {"trial": name, "ok": row.ok, "cause": row.cause, "cpu_s": row.cpu_s, "searches": searches}


def table(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """The kinds of searches, and the ten slowest of them, as Markdown."""
    kinds: dict[str, list[float]] = defaultdict(list)
    slowest: list[tuple[float, str, str]] = []
    for row in rows:
        for kind, seconds, _ in row["searches"]:
            kinds[kind].append(seconds)
            slowest.append((seconds, kind, row["trial"]))
    count = len(rows)
    yield f"{sum(row['ok'] for row in rows)} of {count} trials succeeded; {sum(r['cpu_s'] for r in rows):.0f} s in all."
    yield "\n| search for | asked | p50 ms | p95 ms | longest ms | s in all |\n|---|---|---|---|---|---|"
    for kind in SEARCHES:
        if took := kinds[kind]:
            p50, p95, most = (1e3 * float(np.quantile(took, q)) for q in (0.5, 0.95, 1.0))
            yield f"| {kind} | {len(took)} | {p50:.1f} | {p95:.1f} | {most:.0f} | {sum(took):.1f} |"
    yield "\n| the slowest | search for | s |\n|---|---|---|"
    for seconds, kind, trial in sorted(slowest, reverse=True)[:_SLOWEST]:
        yield f"| {trial} | {kind} | {seconds:.2f} |"


def compared(rows: Iterable[dict[str, Any]], others: Iterable[dict[str, Any]]) -> Iterator[str]:
    """Successes and processor time of the same trials in two files."""
    theirs = {row["trial"]: row for row in others}
    pairs = [(row, theirs[row["trial"]]) for row in rows if row["trial"] in theirs]
    now, then = (sum(pair[k]["ok"] for pair in pairs) for k in (0, 1))
    more, less = (sum(a["ok"] > b["ok"] for a, b in some) for some in (pairs, [pair[::-1] for pair in pairs]))
    share = sum(a["cpu_s"] for a, _ in pairs) / max(sum(b["cpu_s"] for _, b in pairs), 1e-9)
    yield f"{len(pairs)} trials in both: {now} succeed, there {then}; {more} only here, {less} only there;"
    yield f"processor time {share:.2f} of theirs."


@click.command()
@click.option("--skill", "-s", multiple=True, help="Only this skill; may be repeated.")
@click.option("--case", "-c", multiple=True, help="Only this case of the skills; may be repeated.")
@click.option("--policy", "-p", default="expert", show_default=True, help="Policies, joined by commas.")
@click.option("--seeds", type=SEEDS, default="40-43", show_default=True)
@click.option("--robot", type=click.Choice(list(ROBOTS)), default="r1", show_default=True)
@click.option("--out", type=click.Path(path_type=Path), default="runs/hands/searches.jsonl", show_default=True)
@click.option("--compare", type=click.Path(path_type=Path, exists=True), help="A file of another commit.")
@click.option("--table", "only_table", is_flag=True, help="Play nothing: print the table of --out.")
def main(
    skill: tuple[str, ...], case: tuple[str, ...], policy: str, seeds: list[int], robot: str, out: Path,
    compare: Path | None, only_table: bool,
) -> None:  # fmt: skip
    """Play trials of single skills, and print what their searches took."""
    done = {row["trial"] for row in rows_of(out)}
    for seed, (s, c), p in itertools.product(seeds, choose(skill, case), policy.split(",")):
        if not only_table and f"{s}/{c} {p} {robot} {seed}" not in done:
            row = played(Job(s, c, p, seed, "tuning", robot=robot))
            out.parent.mkdir(parents=True, exist_ok=True)
            with out.open("a") as file:
                file.write(json.dumps(row) + "\n")
            click.echo(f"{row['trial']}: {row['cause'] or 'done'}, {row['cpu_s']:.1f} s", err=True)
    rows = rows_of(out)
    for line in table(rows) if compare is None else [*table(rows), "", *compared(rows, rows_of(compare))]:
        click.echo(line)


if __name__ == "__main__":
    main()
