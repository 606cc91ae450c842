"""What interventions win back: q with and without them, of the same tasks, instances and faults, at equal time budgets.

    python -m benchmarks.failing.intervention CALIBRATION WITHOUT WITH [--agree N] [--alone S] [--keep NAME ...]

WITHOUT and WITH have a folder of results for each condition: `clean`, and one for each fault; WITHOUT was played in the
tree `monitored`, WITH in `intervene` or one like it, with the thresholds of CALIBRATION. An episode in which no handoff
failed and there is no alarm, by what the tree says (`--agree`, `--alone`), goes the same way in both, tick by tick, and
needs not be played again: what WITH lacks of these is taken from WITHOUT. Of all others only those count that are in
both. The interval of a difference is that of `mpvi suite report`: instances are drawn anew within each task. Won back
is the share of what the fault costs, that is q of `clean` without intervention less q of the fault.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import click
import numpy as np

from benchmarks.failing.keeping import keeping, tell
from benchmarks.tables import Cell, Column
from mpvi_bt.executive.monitors.alarms import Alarms
from mpvi_bt.executive.monitors.calibration import Calibration
from mpvi_bt.executive.monitors.signals import SIGNALS
from mpvi_bt.ground.marked_yaml import load_marked, validate_data
from mpvi_bt.runs.episode.result import Result, read_result
from mpvi_bt.runs.report.statistics import difference, estimate

COLUMNS = (
    Column(head="fault"),
    Column(head="pairs"),
    Column(head="q without", format=".2f"),
    Column(head="q with", format=".2f"),
    Column(head="difference, 95 %"),
    Column(head="won back"),
    Column(head="simulated s without", format=".0f"),
    Column(head="s with", format=".0f"),
    Column(head="alarms an episode", format=".2f"),
    Column(head="second tries an episode", format=".2f"),
)
Key = tuple[str, int]


def results(folder: Path) -> dict[Key, Result]:
    """The results below a folder, by task and instance."""
    found = [read_result(path) for path in sorted(folder.rglob("json/*.json"))]
    return {(r.task, r.instance_id): r for r in found if r is not None}


def undisturbed(result: Result, known: Calibration, agree: int = 2, alone_s: float | None = None) -> bool:
    """Whether there is nothing in an episode after which `intervene` would do anything else than `monitored`.

    Args:
        result: Of the episode, in `monitored`.
        known: The thresholds.
        agree, alone_s: What makes an alarm, as of `monitors.alarms`.
    """
    for handoff in result.handoffs or []:
        samples = np.array(handoff["samples"], float).reshape(-1, len(SIGNALS))
        past = (known.alarms(str(handoff["skill"]), i, list(values)) for i, values in enumerate(samples))
        alarms = Alarms(agree, alone_s)
        if handoff["ended"] == "failure" or any(alarms.update([name for name, _, _ in of]) for of in past):
            return False
    return True


def row(name: str, without: Mapping[Key, Result], with_: Mapping[Key, Result], clean_q: float) -> list[Cell]:
    """Of one condition."""
    pairs = sorted(without.keys() & with_.keys())
    tasks = [
        np.array([[without[key].q, with_[key].q] for key in pairs if key[0] == task])
        for task in dict.fromkeys(task for task, _ in pairs)
    ]
    found = estimate(tasks, difference)
    before, after = np.mean([table.mean(0) for table in tasks], axis=0)
    cost = clean_q - before
    handoffs = [with_[key].handoffs or [] for key in pairs]
    interval = f" ({found.low:+.2f} to {found.high:+.2f})" if found and found.low is not None else ""
    return [
        name,
        len(pairs),
        float(before),
        float(after),
        f"{after - before:+.2f}{interval}",
        f"{(after - before) / cost:.0%}".replace("%", " %") if name != "clean" and cost > 0 else None,
        *(float(np.mean([arm[key].time.simulator_time for key in pairs])) for arm in (without, with_)),
        float(np.mean([sum(h["reason"] == "alarm" for h in each) for each in handoffs])),
        float(np.mean([sum("again from another place" in str(h["path"]) for h in each) for each in handoffs])),
    ]


@click.command()
@click.argument("calibration", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.argument("without", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.argument("with_", metavar="WITH", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--agree", type=click.IntRange(1, 4), default=2, show_default=True, help="As the tree of WITH has it.")
@click.option("--alone", "alone_s", type=click.FloatRange(0), metavar="S", help="Likewise.")
@keeping
def main(calibration: Path, without: Path, with_: Path, agree: int, alone_s: float | None, **kept: str) -> None:
    """Print q of each condition in WITHOUT and WITH."""
    known = validate_data(*load_marked(calibration), Calibration)
    both = {}
    for folder in sorted(path for path in without.iterdir() if path.is_dir()):
        before = results(folder)
        same = {key: result for key, result in before.items() if undisturbed(result, known, agree, alone_s)}
        both[folder.name] = before, {**same, **results(with_ / folder.name)}
    table: list[list[Cell]] = []
    for name, (before, after) in sorted(both.items(), key=lambda item: item[0] != "clean"):
        if not before.keys() & after.keys():
            continue
        plain = both["clean"][0] if "clean" in both else {}
        q: dict[str, list[float]] = {}
        for key in before.keys() & after.keys() & plain.keys():
            q.setdefault(key[0], []).append(plain[key].q)
        table.append(row(name, before, after, float(np.mean([np.mean(each) for each in q.values()])) if q else 0.0))
    tell(COLUMNS, table, **kept)


if __name__ == "__main__":
    main()
