"""What planning costs: wall time a simulated second, and which part of it a policy plans and sees in.

    python -m benchmarks.planning_share FILE_OR_FOLDER...

Each is a result, such as `mpvi run --json` prints it, or a folder of results, such as that of a suite: one row each, so
that two commits stand side by side. Wall times are of use where they were measured on one machine at one time.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any


def row(results: Iterable[dict[str, Any]]) -> tuple[int, float, float, float]:
    """How many results were timed; wall time a simulated second, that of planning, and planning's share of it."""
    timed = [r for r in results if r.get("wall", {}).get("total_s") and "planning_s" in r["wall"]]
    wall, planning = (sum(r["wall"][key] for r in timed) for key in ("total_s", "planning_s"))
    simulated = sum(r["time"]["simulator_time"] for r in timed)
    return (len(timed), wall / simulated, planning / simulated, planning / wall) if timed else (0, 0.0, 0.0, 0.0)


def main(paths: Sequence[str]) -> None:
    """Print the table."""
    print("| results | episodes | wall s a simulated s | of planning | share |\n|---|---|---|---|---|")
    for path in map(Path, paths):
        files = [path] if path.is_file() else sorted(path.rglob("*.json"))
        parsed = [json.loads(file.read_text()) for file in files]
        count, wall, planning, share = row(r for r in parsed if isinstance(r, dict) and "time" in r)
        print(f"| {path} | {count} | {wall:.3f} | {planning:.3f} | {share:.0%} |")


if __name__ == "__main__":
    main(sys.argv[1:])
