"""Whole episodes over ROS 2, with the house in a process of its own, beside those of `mpvi run` from the same start."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from benchmarks.origin import grid
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.episode import run
from mpvi_bt.runs.episode.result import write_json

TASKS = ("picking_up_trash", "turning_on_radio", "bringing_water")
HEADS = (
    *("task", "by", "q", "steps", "wall time [s]", "steps sent", "states lost", "commands lost"),
    *("picture to command, median [ms]", "p95 [ms]", "state to command, median [ms]", "p95 [ms]"),
)
_MPVI = [sys.executable, "-m", "mpvi_bt.apps.cli"]
_END_S = 60.0  # for the house to score, once the bridge has gone
Row = list[str | int | float | None]


def played_here(task: str, out: Path) -> dict[str, Any]:
    """By `mpvi run`, with an online map as over ROS 2."""
    path = out / f"{task}_run.json"
    if not path.exists():
        click.echo(f"{task}: mpvi run", err=True)
        began = time.monotonic()
        result = run(EpisodeConfig(task, robot="r1", policy="reactive", map="online"))
        write_json(path, {**result, "took_s": time.monotonic() - began})
    return dict(json.loads(path.read_text()))


def played_over_ros(task: str, out: Path, domain: int, mcap: bool) -> tuple[dict[str, Any], dict[str, Any]]:
    """By `mpvi ros2` in the house of `mpvi ros2 house`, perhaps recorded: the results of both."""
    house_file, bridge_file = out / f"{task}_0_house.json", out / f"{task}_ros2.json"
    if not (house_file.exists() and bridge_file.exists()):
        click.echo(f"{task}: mpvi ros2", err=True)
        env = {**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": str(domain)}
        words = [*_MPVI, "ros2", "house", task, "--robot", "r1", "--out", str(out)]
        with subprocess.Popen(
            words, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        ) as house:  # fmt: skip
            words = [*_MPVI, "ros2", "--robot", "r1", "--bridge", "house", "--task", task, "--allow-motion"]
            words += ["--policy", "reactive", "--map", "online", "--no-watch", "--out", str(out)]
            words += ["--mcap", str(out / f"{task}.mcap")] if mcap else []
            try:
                assert house.stderr is not None
                while "ready" not in house.stderr.readline() and house.poll() is None:
                    pass
                subprocess.run(words, env=env, stdout=subprocess.DEVNULL, check=False)
                house.wait(_END_S)
            finally:
                house.terminate()
    return dict(json.loads(house_file.read_text())), dict(json.loads(bridge_file.read_text()))


def rows(task: str, here: dict[str, Any], house: dict[str, Any], bridge: dict[str, Any]) -> list[Row]:
    """Two rows of the table: without ROS, and over it."""
    told, wall = bridge["ros2"], house["wall"]
    lost = sum(topic["lost"] for topic in house["messages"]["commands"].values())
    waits = [wall[f"{kind}_to_command_s"][what] for kind in ("picture", "state") for what in ("median", "p95")]
    return [
        [task, "`mpvi run`", here["q_score"]["final"], here["time"]["simulator_steps"], here["took_s"], *[None] * 7],
        [
            *(task, "`mpvi ros2`", house["q_score"]["final"], house["time"]["simulator_steps"], wall["total_s"]),
            *(house["messages"]["states"], told["lost"], lost),
            *(None if wait is None else 1000 * wait for wait in waits),
        ],
    ]


def table(lines: Sequence[Row]) -> str:
    """As Markdown."""
    return grid(HEADS, [[f"{cell:.2f}" if isinstance(cell, float) else str(cell or "") for cell in line]
                        for line in lines])  # fmt: skip
