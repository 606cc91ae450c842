"""Episodes of today beside those on file: what got worse since, first.

    python -m benchmarks.since NAME FOLDER

NAME is a data file of episodes, such as behavior50; FOLDER has results of the same methods, tasks and start states,
played later. What has no partner is left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import click
import numpy as np

from benchmarks.origin import grid
from benchmarks.paired_results import change, results
from benchmarks.played import Episode, Played
from benchmarks.tables import load
from mpvi_bt.runs.episode.result import Result
from mpvi_bt.runs.report.compare import SAME_Q

HEADS = ("task", "method", "start", "q on file", "q now")


def rows(before: Sequence[Episode], now: Sequence[Result]) -> Iterator[list[str]]:
    """A row for each pair whose q differs, what fell most first; then one of all.

    Raises:
        click.UsageError: There is no pair.
    """
    old = {(one.method, one.task, one.instance, one.seed): one for one in before}
    pairs = [(old[key], one) for one in now if (key := _key(one)) in old]
    if not pairs:
        raise click.UsageError(f"{len(now)} results and {len(before)} on file have no episode in common")
    for was, one in sorted(pairs, key=lambda pair: pair[1].q - pair[0].q):
        if abs(round(one.q, 4) - was.q) > SAME_Q:  # on file it is rounded so
            yield [f"`{one.task}`", f"`{was.method}`", f"{was.instance}", f"{was.q:.2f}", f"{one.q:.2f}"]
    q = np.array([[was.q, one.q] for was, one in pairs])
    told = f"mean of {len(pairs)}; difference {change(q[:, 1] - q[:, 0])}"
    yield [told, "", "", *(f"{mean:.2f}" for mean in q.mean(0))]


def answers(now: Sequence[Result]) -> str:
    """What completion checkers answered in some episodes, and how often that was wrong, in a line."""
    asked = [one.queries for one in now]
    yes, false_yes, false_no = (sum(getattr(one, name) for one in asked) for name in ("yes", "false_yes", "false_no"))
    no = sum(one.asked - one.yes for one in asked)
    return f"checker: {yes} yes, of these {false_yes} false; {no} no, of these {false_no} false"


def _key(one: Result) -> tuple[str, str, int, int]:
    return one.config["method"], one.task, one.instance_id, one.rollout_id


@click.command()
@click.argument("name")
@click.argument("folder", type=click.Path(path_type=Path, exists=True))
def main(name: str, folder: Path) -> None:
    """Print how episodes differ from those on file."""
    file = load(name)
    if not isinstance(file, Played):
        raise click.UsageError(f"{name} has no episodes, which are compared one by one")
    now = results(folder)
    click.echo(f"{grid(HEADS, list(rows(file.episodes, now)))}\n\n{answers(now)}")


if __name__ == "__main__":
    main()
