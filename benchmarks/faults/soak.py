"""`python -m benchmarks.faults.soak`: episodes of mixed tasks in one process, for as long as one likes.

After each episode what the process holds is a row: memory, open files, threads. At the end the memory is drawn over
time. A suite's workers are replaced after forty episodes; this process is not.
"""

from __future__ import annotations

import gc
import itertools
import re
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.faults.trials import BAD, Outcome, crash, drawn, one_line, options, summary
from benchmarks.rows import append, lines_of
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.writing import write_whole
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.methods import load_method
from mpvi_bt.runs.report.plot_svg import Drawing

TASKS = ("picking_up_trash", "tidying_bedroom", "bringing_water", "putting_shoes_on_rack", "make_microwave_popcorn")
INSTANCES = 10
HUNG_S = 300.0  # of wall time beyond what an episode is given: it hangs
WIDTH, HEIGHT, LEFT, TOP, BOTTOM = 720, 260, 70, 24, 40  # of the drawing [px]


def held() -> dict[str, float]:
    """What this process holds: resident memory and its share of what several use [MB], open files, threads."""
    told = Path("/proc/self/smaps_rollup").read_text()
    rss, pss = (re.search(rf"^{name}:\s+(\d+) kB", told, re.MULTILINE) for name in ("Rss", "Pss"))
    return {
        "rss_mb": round(int(rss[1]) / 1000, 1) if rss else 0.0,
        "pss_mb": round(int(pss[1]) / 1000, 1) if pss else 0.0,
        "files": len(list(Path("/proc/self/fd").iterdir())),
        "threads": len(list(Path("/proc/self/task").iterdir())),
    }


def chosen(seed: int, number: int, method: str, policy: str | None) -> EpisodeConfig:
    """The episode of a number: each task in turn, at a start that is drawn."""
    given = {**load_method(method), **({"policy": policy} if policy else {})}
    instance = drawn(seed, number).randrange(INSTANCES)
    return EpisodeConfig(TASKS[number % len(TASKS)], instance, seed=number, **given)


def episode(config: EpisodeConfig, most_s: float) -> Outcome:
    """Play one for at most so much wall time, and say what came of it."""
    from mpvi_bt.runs.episode.episode import run

    began = time.monotonic()
    try:
        stop: Any = nullcontext(lambda: time.monotonic() > began + most_s)
        result = run(config, stop=stop)
    except Exception as error:
        return Outcome(config.task, "crashed", crash(error))
    took_s = time.monotonic() - began
    if took_s > most_s + HUNG_S:
        return Outcome(config.task, "hung", f"{took_s:.0f} s, of {most_s:.0f}")
    if result["ended"] == "backend_error":
        return Outcome(config.task, "crashed", one_line(str(result["failures"][-1])))
    return Outcome(config.task, "went on", f"{result['ended']}, q {result['q_score']['final']:.2f}")


def slope(rows: Sequence[Mapping[str, Any]]) -> float:
    """Growth of resident memory over the second half [MB an episode]; 0 of fewer than four rows."""
    half = [row["rss_mb"] for row in rows[len(rows) // 2 :]]
    return float(np.polyfit(np.arange(len(half)), half, 1)[0]) if len(half) > 1 else 0.0


def drawing(rows: Sequence[Mapping[str, Any]], title: str) -> str:
    """Memory over time as SVG: resident, and the share."""
    plot = Drawing(title, WIDTH)
    minutes = max(max(row["minutes"] for row in rows), 0.1)
    most = max(max(row["rss_mb"] for row in rows), 1.0) * 1.1
    right, floor = WIDTH - 20, HEIGHT - BOTTOM

    def at(row: Mapping[str, Any], key: str) -> tuple[float, float]:
        return LEFT + (right - LEFT) * row["minutes"] / minutes, floor - (floor - TOP) * row[key] / most

    plot.text(LEFT, 14, title, "strong")
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        y = floor - (floor - TOP) * share
        plot.line(LEFT, y, right, y, "axis" if not share else "grid")
        plot.text(LEFT - 6, y + 4, f"{share * most:.0f} MB", "small dim", "end")
        x = LEFT + (right - LEFT) * share
        plot.text(x, floor + 16, f"{share * minutes:.0f} min", "small dim", "middle")
    for key, look in (("pss_mb", "m2"), ("rss_mb", "m1")):
        for row in rows:
            plot.dot(*at(row, key), 2.0, look)
        for one, other in itertools.pairwise(rows):
            plot.line(*at(one, key), *at(other, key), "span")
    plot.legend(HEIGHT - 18, [("m1", "resident memory"), ("m2", "its share of what several use")])
    return plot.svg(HEIGHT, alone=True)


def told(row: Mapping[str, Any]) -> str:
    """A row for a person."""
    what = f"{row['number']}: {row['of']} {row['ended']} {row['told']}"
    return f"{what}; {row['minutes']:.1f} min, {row['rss_mb']:.0f} MB, {row['files']} files, {row['threads']} threads"


def growth(rows: Sequence[Mapping[str, Any]]) -> str:
    """What the process held from the second episode on, when all is loaded, to the end."""
    first, last = rows[min(1, len(rows) - 1)], rows[-1]
    ends = ", ".join(f"{name} {first[name]} to {last[name]}" for name in ("files", "threads"))
    return (
        f"{last['minutes']:.0f} min; second episode to last: {first['rss_mb']:.0f} to {last['rss_mb']:.0f} MB, "
        f"{slope(rows):+.2f} MB an episode over the second half; {ends}"
    )


@click.command()
@options(100_000, "soak")
@click.option("--minutes", type=click.FloatRange(min=0), default=120.0, show_default=True, help="All runs together.")
@click.option("--method", default="mpvi", show_default=True)
@click.option("--policy", help="Another one than the method's.")
@click.option("--episode-s", type=click.FloatRange(min=1), default=60.0, show_default=True,
              help="Wall time after which an episode is broken off, and the next one begins.")  # fmt: skip
def main(
    seed: int, count: int, out: Path, only: int | None, minutes: float, method: str, policy: str | None,
    episode_s: float,
) -> None:  # fmt: skip
    """Play episodes one after the other in one process, and say what it holds after each."""
    try:
        rows = [row for _, row in lines_of(out) if row["seed"] == seed and only is None]
        before, began = rows[-1]["minutes"] if rows else 0.0, time.monotonic()
        for number in range(len(rows), count) if only is None else [only]:
            if before + (time.monotonic() - began) / 60 >= minutes:
                break
            outcome = episode(chosen(seed, number, method, policy), episode_s)
            gc.collect()
            spent = round(before + (time.monotonic() - began) / 60, 3)
            rows.append({"seed": seed, "number": number, **asdict(outcome), "minutes": spent, **held()})
            click.echo(told(rows[-1]), err=True)
            if only is None:
                append(out, rows[-1])
        if only is None and rows:
            title = f"{policy or method}: {len(rows)} episodes in one process"
            write_whole(out.with_suffix(".svg"), drawing(rows, title))
    except UserError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(error.exit_code)
    click.echo(summary(rows, "soak"))
    click.echo(growth(rows) if rows else "no time for an episode")
    sys.exit(int(any(row["ended"] in BAD for row in rows)))


if __name__ == "__main__":
    main()
