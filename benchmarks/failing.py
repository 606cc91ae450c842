"""How well the monitors' signals tell failing handoffs from those that go well.

    for i in 0 1 2 3 4 5 6 7 8 9; do
      mpvi run picking_up_trash --instance $i --method expert --unit monitored --out runs/clean
      mpvi run picking_up_trash --instance $i --method expert --unit monitored --out runs/freeze --policy-faults freeze
    done
    python -m benchmarks.failing runs/clean runs/freeze [--fit 5] [--json]

Thresholds are fitted on the first folder's instances below --fit; all figures are of the other instances. A handoff
counts as failing if the policy had faults and the checker never found it complete. A signal's score is the most that
it gets to, in thresholds; that of two in agreement is the second largest of the four at one time.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np

from mpvi_bt.episode.handoffs import Watched, read_handoffs
from mpvi_bt.monitors.calibration import ALPHA, Calibration, calibrate
from mpvi_bt.monitors.signals import SAMPLE_S, SIGNALS
from mpvi_bt.robot.solids import Array

AGREE = "two agree"


def ratios(known: Calibration, watched: Watched) -> Array:
    """(n, 5) each signal in thresholds at each sample, and the second largest of them."""
    levels = known.skills[watched.run.skill].thresholds
    rows = []
    for sample, values in enumerate(watched.run.samples):
        row = [
            value / max(levels[name][min(sample, len(levels[name]) - 1)], 1e-9)  # type: ignore[index]
            for name, value in zip(SIGNALS, values, strict=True)
        ]
        rows.append([*row, sorted(row)[-2]])
    return np.array(rows)


def auroc(failing: Sequence[float], well: Sequence[float]) -> float | None:
    """The probability that a failing one scores higher, ties halved; None without both kinds."""
    if not failing or not well:
        return None
    a, b = np.array(failing)[:, None], np.array(well)[None]
    return float(np.mean((a > b) + 0.5 * (a == b)))


def figures(
    known: Calibration, failing: Sequence[Watched], well: Sequence[Watched]
) -> dict[str, dict[str, float | None]]:
    """Signal to AUROC, share of failing handoffs with an alarm, median time to it [s], and false alarms a handoff."""
    bad, good = [ratios(known, w) for w in failing], [ratios(known, w) for w in well]
    found: dict[str, dict[str, float | None]] = {}
    for column, name in enumerate((*SIGNALS, AGREE)):
        first = [np.flatnonzero(r[:, column] > 1.0) for r in bad]
        times = [float(at[0]) * SAMPLE_S for at in first if len(at)]
        found[name] = {
            "auroc": auroc([r[:, column].max() for r in bad], [r[:, column].max() for r in good]),
            "found": len(times) / len(bad) if bad else None,
            "time_s": float(np.median(times)) if times else None,
            "false": float(np.mean([(r[:, column] > 1.0).any() for r in good])) if good else None,
        }
    return found


@click.command()
@click.argument("clean", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.argument("faulty", type=click.Path(exists=True, file_okay=False, path_type=Path), nargs=-1, required=True)
@click.option("--fit", default=5, show_default=True, help="Instances below this number set the thresholds.")
@click.option("--alpha", default=ALPHA, show_default=True, help="As of mpvi calibrate.")
@click.option("--json", "as_json", is_flag=True)
def main(clean: Path, faulty: tuple[Path, ...], fit: int, alpha: float, as_json: bool) -> None:
    """Print the figures of each folder of faults beside the folder without."""
    plain = read_handoffs(clean)
    fitted = [w.run for w in plain.watched if w.instance < fit and w.ended == "success"]
    known, short = calibrate(fitted, plain.policy, plain.robot, alpha)
    tested = [w for w in plain.watched if w.instance >= fit and w.run.skill in known.skills]
    told: dict[str, object] = {"fitted": {name: s.runs for name, s in known.skills.items()}, "too_few": short}
    for folder in faulty:
        disturbed = [w for w in read_handoffs(folder).watched if w.instance >= fit and w.run.skill in known.skills]
        failing = [w for w in disturbed if w.ended != "success"]
        well = [w for w in (*tested, *disturbed) if w.ended == "success"]
        told[folder.name] = {"failing": len(failing), "well": len(well), **figures(known, failing, well)}
    if as_json:
        click.echo(json.dumps(told, indent=1))
        return
    click.echo(f"thresholds by {told['fitted']}; too few: {short}")
    for folder in faulty:
        rows = told[folder.name]
        assert isinstance(rows, dict)
        click.echo(f"\n{folder.name}: {rows['failing']} failing handoffs, {rows['well']} that went well")
        click.echo(f"{'signal':14}{'AUROC':>7}{'found':>7}{'after s':>9}{'false':>7}")
        for name in (*SIGNALS, AGREE):
            cells = (
                "-" if (v := rows[name][key]) is None else f"{v:.2f}" for key in ("auroc", "found", "time_s", "false")
            )
            click.echo(
                f"{name:14}" + "".join(f"{cell:>{width}}" for cell, width in zip(cells, (7, 7, 9, 7), strict=True))
            )


if __name__ == "__main__":
    main()
