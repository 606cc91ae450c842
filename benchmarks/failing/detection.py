"""How well the monitors' signals tell failing handoffs from those that go well.

    python -m benchmarks.failing.detection CALIBRATION FOLDER [--keep NAME --command ... --date ...]

FOLDER has a folder of results for each condition: `clean`, and one for each fault. The thresholds are those of the
file, fixed before. A handoff counts as failing if the policy had faults and the checker never found it complete, and as
going well if the checker did. A signal's score is the most that it gets to, in thresholds; that of two in agreement is
the second largest of the four at one time, that of any of them the largest, and that of one that lasts the most that
`stall` or `grip` stays above for 10 s. False alarms are counted in `clean`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np

from benchmarks.failing.keeping import keeping, tell
from benchmarks.tables import Cell, Column
from mpvi_bt.executive.monitors.alarms import OUTCOMES
from mpvi_bt.executive.monitors.calibration import Calibration, load_calibration
from mpvi_bt.executive.monitors.signals import SAMPLE_S, SIGNALS
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.runs.episode.handoffs import Watched, read_handoffs

ALONE_S = 10.0  # our choice: in calibrating_*.yaml neither is past its threshold for longer than 8 s (`lasting`)
AGREE, ANY, LASTING = "two agree", "any", "two agree, or stall or grip for 10 s"
COLUMNS = (
    Column(head="fault"),
    Column(head="signal"),
    Column(head="AUROC", format=".2f"),
    Column(head="failing handoffs found"),
    Column(head="after s, median", format=".1f"),
    Column(head="false alarms an episode", format=".2f"),
)


def ratios(known: Calibration, watched: Watched) -> Array:
    """(n, 7) each signal in thresholds at each sample, then what `AGREE`, `ANY` and `LASTING` go by."""
    levels = known.skills[watched.run.skill].thresholds
    rows = []
    for sample, values in enumerate(watched.run.samples):
        row = [
            value / max(levels[name][min(sample, len(levels[name]) - 1)], 1e-9)  # type: ignore[index]
            for name, value in zip(SIGNALS, values, strict=True)
        ]
        rows.append([*row, *sorted(row)[-2:]])
    found = np.array(rows)
    outcomes = [SIGNALS.index(name) for name in sorted(OUTCOMES)]
    alone = round(ALONE_S / SAMPLE_S) + 1
    lasting = [
        found[max(i + 1 - alone, 0) : i + 1, outcomes].min(0).max() if i + 1 >= alone else 0.0 for i in range(len(rows))
    ]
    return np.column_stack([found, np.maximum(found[:, 4], lasting)])


def auroc(failing: Sequence[float], well: Sequence[float]) -> float | None:
    """The probability that a failing one scores higher, ties halved; None without both kinds."""
    if not failing or not well:
        return None
    a, b = np.array(failing)[:, None], np.array(well)[None]
    return float(np.mean((a > b) + 0.5 * (a == b)))


def rows(fault: str, known: Calibration, faulty: Sequence[Watched], clean: Sequence[Watched]) -> list[list[Cell]]:
    """Of one fault, a row for each signal and for each way to make an alarm of them."""
    bad = [ratios(known, w) for w in faulty if w.ended != "success"]
    good = [ratios(known, w) for w in (*clean, *faulty) if w.ended == "success"]
    calm = [ratios(known, w) for w in clean if w.ended == "success"]
    episodes = len({(w.task, w.instance) for w in clean})
    found: list[list[Cell]] = []
    for column, name in enumerate((*SIGNALS, AGREE, ANY, LASTING)):
        first = [np.flatnonzero(r[:, column] > 1.0) for r in bad]
        times = [float(at[0]) * SAMPLE_S for at in first if len(at)]
        false = sum(bool((r[:, column] > 1.0).any()) for r in calm)
        found.append([
            None if found else fault,
            name,
            auroc([r[:, column].max() for r in bad], [r[:, column].max() for r in good]),
            (len(times), len(bad)),
            float(np.median(times)) if times else None,
            false / episodes if episodes else None,
        ])  # fmt: skip
    return found


@click.command()
@click.argument("calibration", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@keeping
def main(calibration: Path, folder: Path, **kept: str) -> None:
    """Print the figures of each fault in FOLDER by the thresholds of CALIBRATION."""
    plain = read_handoffs(folder / "clean")
    known = load_calibration(calibration, plain.policy, plain.robot)
    clean = [w for w in plain.watched if w.run.skill in known.skills]
    table: list[list[Cell]] = []
    for fault in sorted(path for path in folder.iterdir() if path.is_dir() and path.name != "clean"):
        faulty = [w for w in read_handoffs(fault).watched if w.run.skill in known.skills]
        table += rows(fault.name, known, faulty, clean)
    tell(COLUMNS, table, **kept)


if __name__ == "__main__":
    main()
