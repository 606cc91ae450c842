"""`mpvi calibrate`: thresholds of the monitors from a suite's results."""

from __future__ import annotations

import json
from pathlib import Path

import click

from mpvi_bt.executive.drawing.terminal import give, tell


@click.command()
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option(
    "--alpha",
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    default=0.1,
    show_default=True,
    help="Share of good handoffs in which a signal may pass its threshold.",
)
@click.option(
    "--out",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Write the thresholds here.  [default: FOLDER/calibration.json]",
)
@click.option("--json", "as_json", is_flag=True, help="For programs: one JSON object.")
def calibrate(folder: Path, alpha: float, out: Path | None, as_json: bool) -> None:
    """Set the thresholds of monitors from the successful handoffs in FOLDER.

    FOLDER holds the results of runs with --unit monitored or --unit intervene, by one policy on one robot.
    """
    from mpvi_bt.executive.monitors.calibration import calibrate, fewest_runs
    from mpvi_bt.runs.episode.handoffs import read_handoffs

    found = read_handoffs(folder)
    known, short = calibrate(found.went_well, found.policy, found.robot, alpha)
    path = out or folder / "calibration.json"
    known.write(path)
    skills = {name: levels.runs for name, levels in known.skills.items()}
    if as_json:
        tell(json.dumps({"out": str(path), "alpha": alpha, "calibrated": skills, "too_few": short}, indent=2))
        return
    lines = [f"{name}: {runs} handoffs that went well" for name, runs in skills.items()]
    lines += [f"{name}: not calibrated, {runs} of {fewest_runs(alpha)} handoffs" for name, runs in short.items()]
    give("\n".join([f"policy {found.policy} on {found.robot}, alpha {alpha:g}", *lines, f"written to {path}", ""]))
