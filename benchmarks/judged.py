"""Completion checkers against the truth, on the same pictures: how often each says yes and no, and wrongly.

    python -m benchmarks.judged FOLDER [--checkers visual,learned] [--tasks ...] [--instances 0-1] [--keep NAME ...]

Episodes are played by a method with each of some triggers, and whenever that asks, every checker is asked about the
same criterion with the same picture. The first of them is believed, so that its noes have the policy look again, as in
any episode. The truth is the oracle's at that moment; what it does not know is left out. By events nearly all is true
when it is asked for; at fixed times little is. What FOLDER has of the episodes is not played again.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import click

from benchmarks.failing.keeping import keeping, tell
from benchmarks.hands.__main__ import SEEDS
from benchmarks.tables import Cell, Column
from mpvi_bt.executive.completion.criteria import parse
from mpvi_bt.executive.completion.oracle import OracleChecker
from mpvi_bt.ground.protocols import Checker, Judgement
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.ground.writing import write_whole
from mpvi_bt.runs.choices.checkers import make_checker
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.methods import load_method
from mpvi_bt.runs.choices.world_truth import TrueState
from mpvi_bt.runs.episode import assembly
from mpvi_bt.runs.episode.episode import run

# Our choice: of the tasks that the method finishes, those whose criteria are of many kinds.
TASKS = (
    "picking_up_trash,tidying_bedroom,bringing_water,hiding_Easter_eggs,putting_shoes_on_rack,turning_on_radio,"
    "preparing_lunch_box,storing_food"
)
COLUMNS = tuple(
    Column(head=head)
    for head in ("checker", "criterion", "asked", "true", "yes", "false yes, of noes", "false no, of yeses")
)


class Compared:
    """Asks several checkers and believes the first (implements `Checker`).

    Attributes:
        name: That of the first.
        needs_image: Yes.
        questions: What was asked so far: "criterion", "camera", "truth", and "said", a checker's name to its answer and
            its reason.
    """

    needs_image = True

    def __init__(self, checkers: Mapping[str, Checker], oracle: OracleChecker) -> None:
        """Compare `checkers` with what `oracle` knows."""
        self._checkers, self._oracle = dict(checkers), oracle
        self.name = next(iter(self._checkers))
        self.questions: list[dict[str, Any]] = []

    def check(self, criterion: str, image: CameraImage | None) -> Judgement:
        """What the first one says."""
        truth, _ = self._oracle.decide(criterion)
        judged = {name: checker.check(criterion, image) for name, checker in self._checkers.items()}
        said = {name: [bool(answer.complete), answer.reason] for name, answer in judged.items()}
        camera = "" if image is None else image.camera
        self.questions.append({"criterion": criterion, "camera": camera, "truth": truth, "said": said})
        return judged[self.name]


def play(config: EpisodeConfig, checkers: Sequence[str], folder: Path) -> list[dict[str, Any]]:
    """The questions of one episode, played unless it is there already."""
    path = folder / f"{config.task}_{config.instance}_{config.trigger.replace(':', '-')}.json"
    if path.exists():
        return list(json.loads(path.read_text(encoding="utf-8")))
    made: list[Compared] = []

    def make(given: str, world: Any, vocabulary: Any, seed: int, *others: Any) -> Compared:
        each = {name: make_checker(name, world, vocabulary, seed, *others) for name in checkers}
        made.append(Compared(each, OracleChecker(TrueState(world), vocabulary)))
        return made[0]

    with mock.patch.object(assembly, "make_checker", make):
        run(replace(config, checker="visual"))  # labels are rendered
    write_whole(path, json.dumps(made[0].questions))
    return made[0].questions


def rows(questions: Sequence[Mapping[str, Any]]) -> Iterator[list[Cell]]:
    """Of each checker a row for all criteria, and one for each kind of criterion."""
    known = [q for q in questions if q["truth"] is not None]
    kinds: dict[str, list[Mapping[str, Any]]] = {"all": known}
    for question in known:
        asked = parse(question["criterion"])
        kinds.setdefault(asked.relation if asked else "other", []).append(question)
    for checker in dict.fromkeys(name for q in known for name in q["said"]):
        for kind, members in sorted(kinds.items(), key=lambda item: -len(item[1])):
            pairs = [(q["said"][checker][0], q["truth"]) for q in members if checker in q["said"]]
            true = sum(truth for _, truth in pairs)
            false_yes = sum(said and not truth for said, truth in pairs)
            false_no = sum(truth and not said for said, truth in pairs)
            yes = sum(said for said, _ in pairs)
            yield [f"`{checker}`", kind, len(pairs), true, yes, (false_yes, len(pairs) - true), (false_no, true)]


@click.command()
@click.argument("folder", type=click.Path(file_okay=False, path_type=Path))
@click.option(
    "--checkers", default="visual,learned", show_default=True, help="Joined by commas; the first is believed."
)
@click.option("--tasks", default=TASKS, show_default=True, help="Names, joined by commas.")
@click.option("--instances", type=SEEDS, default="0-1", show_default=True)
@click.option("--triggers", default="proprioceptive,periodic:150", show_default=True, help="Joined by commas.")
@click.option("--method", default="expert", show_default=True, help="Everything else, by name.")
@keeping
def main(
    folder: Path, checkers: str, tasks: str, instances: list[int], triggers: str, method: str, **kept: str
) -> None:
    """Play what FOLDER does not have, and print the table."""
    folder.mkdir(parents=True, exist_ok=True)
    found: list[dict[str, Any]] = []
    for task, instance, trigger in itertools.product(tasks.split(","), instances, triggers.split(",")):
        config = EpisodeConfig(task, instance, **{**load_method(method), "trigger": trigger})
        asked = play(config, checkers.split(","), folder)
        found += asked
        click.echo(f"{task} {instance} {trigger}: {len(asked)} questions, {len(found)} so far", err=True)
    tell(COLUMNS, list(rows(found)), **kept)


if __name__ == "__main__":
    main()
