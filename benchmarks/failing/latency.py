"""What latency does to q: d control steps for each answer of the policy alone, or of policy, checker and planner.

    python -m benchmarks.failing.latency --tasks turning_on_radio,hanging_pictures --instances 0-2
    python -m benchmarks.failing.latency --table [--keep NAME --command ... --date ...] [--plot docs/latency.svg]

The expert answers every step by itself, which no large model does; so it is asked for four actions at once, of one
observation, and is blind until they are carried out. The robot holds until a chunk is there. Each d is played with the
trigger of `mpvi` and with that of `no_trigger`. A killed run goes on where it stopped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.failing.keeping import keeping, tell
from benchmarks.rows import append, lines_of
from benchmarks.tables import Cell, Column
from mpvi_bt.executive.actions.chunks import WrappedPolicy
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Policy
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.methods import load_method
from mpvi_bt.runs.choices.policies import PolicyInputs, make_policy
from mpvi_bt.runs.episode.episode import run
from mpvi_bt.runs.report.plot_svg import Drawing

STEPS = (0, 1, 2, 4, 8, 12, 20)
CHUNK = 4  # actions an answer. Our choice: blind for 8 the expert misses both tasks below without any latency
LATE = {"policy alone": ("policy",), "all parts": ("policy", "checker", "planner")}
TRIGGERS = {"triggers": "proprioceptive", "every 10 s": "periodic:300"}
CURVES = [(late, trigger) for trigger in TRIGGERS for late in LATE]
COLUMNS = (
    Column(head="d, steps"),
    Column(head="s", format=".2f"),
    *(Column(head=f"q: {late}, {trigger}", format=".2f") for late, trigger in CURVES),
    *(Column(head=f"simulated s: {late}, {trigger}", format=".0f") for late, trigger in CURVES),
    Column(head="stale actions", format=".2f"),
)
_KEY = ("task", "instance", "steps", "late", "trigger")


class InChunks(WrappedPolicy):
    """A policy that answers one action at a time, asked for several of one observation."""

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """(4, 23)."""
        return np.concatenate([self._policy.infer(observation) for _ in range(CHUNK)])


def chunked(ground: PolicyInputs) -> Policy:
    """The expert, in chunks."""
    return InChunks(make_policy("expert", ground))


def play(task: str, instance: int, steps: int, late: str, trigger: str) -> dict[str, Any]:
    """One episode, as a line of the file."""
    latency = ",".join(f"{part}={steps / CONTROL_HZ!r}" for part in LATE[late]) if steps else None
    choices = {**load_method("expert"), "trigger": TRIGGERS[trigger], "latency": latency, "method": None}
    result = run(EpisodeConfig(task, instance, **choices), make=chunked)
    return {
        **dict(zip(_KEY, (task, instance, steps, late, trigger), strict=True)),
        "q": result["q_score"]["final"],
        "simulated_s": round(result["time"]["simulator_time"], 2),
        "asked": result["queries"]["asked"],
        "stale": result.get("lateness", {}).get("stale_action_ratio", 0.0),
    }


def rows(found: Sequence[Mapping[str, Any]]) -> list[list[Cell]]:
    """A row for each d; without latency "all parts" is "policy alone"."""

    def mean(key: str, steps: int, late: str, trigger: str) -> float | None:
        late = late if steps else "policy alone"
        values = [row[key] for row in found if (row["steps"], row["late"], row["trigger"]) == (steps, late, trigger)]
        return float(np.mean(values)) if values else None

    return [
        [
            steps,
            steps / CONTROL_HZ,
            *(mean("q", steps, *curve) for curve in CURVES),
            *(mean("simulated_s", steps, *curve) for curve in CURVES),
            mean("stale", steps, *CURVES[0]),
        ]
        for steps in STEPS
    ]


def plot(table: Sequence[Sequence[Cell]]) -> str:
    """Simulated time at each d as bars, one for each curve, hatched where goals were missed, as SVG."""
    width, left, tall, bar = 700.0, 44.0, 170.0, 17.0
    n = len(CURVES)
    drawing = Drawing("Simulated time of an episode by latency", width)
    marks = [(f"m{i + 1}", f"{late}, {trigger}") for i, (late, trigger) in enumerate(CURVES)]
    top = drawing.legend(0, [*marks, ("same hatched", "q below 1")]) + 12
    longest = max((s for row in table for s in row[2 + n : 2 + 2 * n] if isinstance(s, float)), default=1.0)
    for tick in range(0, int(longest) + 1, 20):
        y = top + tall * (1 - tick / longest)
        drawing.line(left, y, width, y, "grid")
        drawing.text(left - 6, y + 4, f"{tick} s", "dim small", "end")
    group = (width - left) / len(table)
    for k, (steps, seconds, *values) in enumerate(table):
        x = left + group * k + (group - bar * n) / 2
        for i, (q, taken_s) in enumerate(zip(values[:n], values[n : 2 * n], strict=True)):
            if isinstance(q, float) and isinstance(taken_s, float):
                high = tall * taken_s / longest
                box = x + bar * i, top + tall - high, bar - 3, high
                drawing.rect(*box, f"m{i + 1}", f"{taken_s:.0f} s, q {q:.2f}")
                if q < 1:
                    drawing.hatch(*box)
        drawing.text(left + group * (k + 0.5), top + tall + 16, f"d = {steps}", "small", "middle")
        drawing.text(left + group * (k + 0.5), top + tall + 30, f"{seconds:.2f} s", "dim small", "middle")
    return drawing.svg(top + tall + 38, alone=True)


@click.command()
@click.option("--tasks", default="turning_on_radio,attach_a_camera_to_a_tripod", show_default=True)
@click.option("--instances", default="0-2", show_default=True, help="First and last.")
@click.option("--out", default=Path("runs/latency.jsonl"), show_default=True, type=click.Path(path_type=Path))
@click.option("--table", "only_table", is_flag=True, help="Play nothing; tell what the file has.")
@click.option("--plot", "picture", type=click.Path(path_type=Path), help="Draw the times there, as SVG.")
@keeping
def main(tasks: str, instances: str, out: Path, only_table: bool, picture: Path | None, **kept: str) -> None:
    """Play what is missing, instance by instance, then print q and time at each latency."""
    found = [row for _, row in lines_of(out)]
    first, _, last = instances.partition("-")
    jobs = [
        (task, instance, steps, late, trigger)
        for instance in range(int(first), int(last or first) + 1)
        for task in tasks.split(",")
        for late, trigger in CURVES
        for steps in STEPS
        if steps or late == "policy alone"
    ]
    played = {tuple(row[key] for key in _KEY) for row in found}
    for job in [] if only_table else [job for job in jobs if job not in played]:
        row = play(*job)
        append(out, row)
        found.append(row)
        click.echo(f"{' '.join(map(str, job))}: q {row['q']:.2f}, {row['simulated_s']:.0f} s simulated", err=True)
    table = rows(found)
    tell(COLUMNS, table, **kept)
    if picture is not None:
        picture.write_text(plot(table) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
