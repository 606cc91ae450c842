"""Scenes that are played and recorded one after the other, each by its seed, with a log of what came of them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from benchmarks.pool import play_all

_WALL_LIMIT_S = 300.0
_TOLD = 20  # scenes between two lines


def record(folder: Path, play: Callable[[int], dict[str, Any]], first: int, count: int, workers: int) -> None:
    """Play the scenes that the folder's log does not have yet.

    Args:
        folder: Of the log; it is made if it is not there.
        play: Plays and records the scene of a seed; its row says under "ok" whether it was kept.
        first: The first seed.
        count: How many.
        workers: Processes.
    """
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / "log.jsonl"
    tried = {json.loads(line)["seed"] for line in log.read_text().splitlines()} if log.exists() else set()
    seeds = [seed for seed in range(first, first + count) if seed not in tried]
    kept = 0
    with log.open("a", encoding="utf-8") as file:
        for done, row in enumerate(play_all(play, _failed, seeds, workers, _WALL_LIMIT_S), start=1):
            kept += row["ok"]
            file.write(json.dumps(row) + "\n")
            file.flush()
            if done % _TOLD == 0 or done == len(seeds):
                click.echo(f"{done}/{len(seeds)}: {kept} kept", err=True)


def _failed(seed: int, cause: str) -> dict[str, Any]:
    return {"seed": seed, "ok": False, "note": cause}
