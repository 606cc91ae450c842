"""Episodes by the renderer's labels and by learned eyes, in pairs: q of each, and what learned eyes stop at first.

    python -m benchmarks.eyes.paired FOLDER [--minutes 60] [--methods mpvi,mpvi_pixels] [--keep NAME ...]

Tasks of the suite `behavior30` in the family house and five of the paper's ablation in three drawn houses take turns,
in an order drawn by lot: wherever it stops, what was played is a fair sample. What has begun is played to its end.
"""

from __future__ import annotations

import json
import random
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import click
import numpy as np

from benchmarks.failing.keeping import keeping, tell
from benchmarks.paired_results import results
from benchmarks.tables import Cell, Column
from mpvi_bt.ground.writing import write_whole
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.methods import load_method
from mpvi_bt.runs.episode.episode import run
from mpvi_bt.runs.episode.result import Result
from mpvi_bt.runs.report.failures import reason
from mpvi_bt.runs.suite.suites import load_suite

# Our choice.
HOUSES = ("generated:1", "generated:2", "generated:3")
Job = tuple[str, str | None]  # task, and house if it is not the task's own


def order(seed: int) -> list[Job]:
    """What is played, by lot: a task of `behavior30`, one in a drawn house, and so on."""
    lot = random.Random(seed)
    own: list[Job] = [(task, None) for task in load_suite("behavior30").tasks]
    drawn: list[Job] = [(task, house) for task in load_suite("localization").tasks for house in HOUSES]
    lot.shuffle(drawn)
    lot.shuffle(own)
    turns = [job for pair in zip(own, drawn, strict=False) for job in pair]
    return [*turns, *own[len(drawn) :], *drawn[len(own) :]]


def play(job: Job, method: str, instance: int, folder: Path) -> None:
    """Play an episode; its result goes into the folder."""
    task, house = job
    config = EpisodeConfig(task, instance, **{**load_method(method), "house": house})
    name = f"{task}_{(house or 'own').replace(':', '-')}_{instance}_{method}.json"
    write_whole(folder / name, json.dumps(run(config)))


def rows(found: Sequence[Result], methods: Sequence[str]) -> Iterator[list[Cell]]:
    """A row for each task and house that all methods have played, and one of the means."""
    played = {(_job(one), one.instance_id, one.config["method"]): one for one in found}
    keys = list(dict.fromkeys((_job(one), one.instance_id) for one in found))
    whole = [key for key in keys if all((*key, method) in played for method in methods)]
    for job, instance in whole:
        each = [played[job, instance, method] for method in methods]
        asked = each[-1].queries
        first = reason(each[-1].failures[0]) if each[-1].failures else ""
        judged = f"{asked.false_no} of {asked.asked - asked.yes}, {asked.false_yes} of {asked.yes}"
        yield [f"`{job[0]}`", job[1] or "own", instance, *(one.q for one in each), first, judged]
    means = [float(np.mean([played[*key, method].q for key in whole])) if whole else None for method in methods]
    yield [f"mean of {len(whole)}", "", "", *means, "", ""]


def columns(methods: Sequence[str]) -> tuple[Column, ...]:
    """Of the table."""
    q = [Column(head=f"q `{method}`", format=".2f") for method in methods]
    last = (f"what `{methods[-1]}` stopped at first", "false noes, false yeses of it")
    return (*(Column(head=head) for head in ("task", "house", "start")), *q, *(Column(head=head) for head in last))


def _job(result: Result) -> Job:
    house = result.config.get("house")
    return result.task, None if house is None else str(house)


@click.command()
@click.argument("folder", type=click.Path(file_okay=False, path_type=Path))
@click.option("--minutes", type=float, default=60.0, show_default=True, help="No episode begins later.")
@click.option("--methods", default="mpvi,mpvi_pixels", show_default=True, help="Joined by commas.")
@click.option("--instance", type=click.IntRange(0), default=0, show_default=True)
@click.option("--seed", type=int, default=57, show_default=True, help="Of the lot.")
@keeping
def main(folder: Path, minutes: float, methods: str, instance: int, seed: int, **kept: str) -> None:
    """Play what FOLDER does not have, and print the table of all that it has."""
    folder.mkdir(parents=True, exist_ok=True)
    names, begun = methods.split(","), time.monotonic()
    there = {(_job(one), one.instance_id, one.config["method"]) for one in results(folder)}
    for job in order(seed):
        for method in names:
            if (job, instance, method) not in there and time.monotonic() - begun < 60 * minutes:
                click.echo(f"{job[0]} {job[1] or ''} {method}", err=True)
                play(job, method, instance, folder)
    tell(columns(names), list(rows(results(folder), names)), **kept)


if __name__ == "__main__":
    main()
