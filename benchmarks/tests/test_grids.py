"""The benchmark of grids makes maps that one can drive in, and tells what is exact from what is not."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
from click.testing import CliRunner

from benchmarks.grids import looks, paths
from benchmarks.grids.__main__ import main
from benchmarks.grids.maps import costs, house, reachable
from benchmarks.grids.timing import Side, in_turns, ratio


def test_a_house_is_the_same_for_the_same_seed_and_hangs_together() -> None:
    """Nearly every cell where the footprint fits can be reached, and another seed gives another house."""
    one = house(300, 240, seed=3)
    np.testing.assert_array_equal(one.occupied, house(300, 240, seed=3).occupied)
    assert (one.occupied != house(300, 240, seed=4).occupied).any()
    for cost in costs(one).values():
        assert len(reachable(cost)) > 0.98 * np.isfinite(cost).sum()
        assert cost.min() == 1.0


def test_a_side_that_finds_dearer_paths_is_marked() -> None:
    """Its paths are compared with the best of those who solve the same problem."""
    cost = np.ones((5, 9), np.float32)
    straight, detour = np.array([[2, c] for c in range(9)]), np.array([[2, 0], *([1, c] for c in range(1, 8)), [2, 8]])
    sides = [
        Side("good", lambda case: straight, paths.KEPT),
        Side("poor", lambda case: detour, paths.KEPT),
        Side("other", lambda case: detour, paths.CUT),
    ]
    verdicts = paths.judge(cost, in_turns(sides, [None], 1, lambda at: None))
    assert verdicts["good"] == ("corners kept, +0.00 %", True)
    assert verdicts["poor"][1] is False
    assert verdicts["other"][1] is None, "nobody to compare with"


def test_heapq_and_ours_agree() -> None:
    """The plain search that others are checked against finds what ours finds."""
    cost = costs(house(120, 130))["clearance"]
    cells = reachable(cost)
    ends = (int(cells[0][0]), int(cells[0][1])), (int(cells[-1][0]), int(cells[-1][1]))
    ours, *_, plain = (side.run(ends) for side in paths.sides(cost, 1) if side.group == paths.KEPT)
    assert math.isclose(paths.cost_of(cost, ours), paths.cost_of(cost, plain), rel_tol=1e-9)


def test_sides_take_turns_and_slow_ones_only_some() -> None:
    """Each round runs every side on every case, in alternating order; a slow side has its first cases once."""
    order: list[str] = []
    sides = [Side("a", lambda case: order.append("a")), Side("b", lambda case: order.append("b"), most=1)]
    one, other = in_turns(sides, [0, 1], 2, lambda at: None)
    assert (len(one.seconds), len(other.seconds)) == (4, 1)
    assert (len(one.results), len(other.results)) == (2, 1)
    assert order.count("b") == 1
    assert ratio(one, other) > 0


def test_seen_cells_are_checked_against_lines_of_sight() -> None:
    """Ours misses hardly any cell whose center is in sight."""
    grid_map = house(160, 130)
    free = reachable(costs(grid_map)["octile"])
    views = [looks.Look.taken(grid_map, (int(r), int(c)), float(k)) for k, (r, c) in enumerate(free[:: len(free) // 6])]
    timed = in_turns([next(looks.sides(grid_map))], views, 1, lambda at: None)
    missed, more = (float(word.split()[1]) for word in looks.judge(grid_map, views, timed)["ours"][0].split(","))
    assert missed < 0.3
    assert more < 6.0


def test_the_table_is_printed_and_written(tmp_path: Path) -> None:
    """Every job is in the table and in the file, ours is exact, and a size that is none is refused."""
    file = tmp_path / "rows.json"
    done = CliRunner().invoke(main, ["--sizes", "120x120", "--no-first", "--json", str(file)])
    assert done.exit_code == 0, done.output
    rows = json.loads(file.read_text(encoding="utf-8"))["rows"]
    own = {row["job"]: row["exact"] for row in rows if row["side"] == "ours"}
    assert len(own) == 5
    assert sum(exact is True for exact in own.values()) == 4
    assert all(job in done.output for job in own)
    refused = CliRunner().invoke(main, ["--sizes", "12x9"])
    assert refused.exit_code == 2
    assert "'12x9'" in refused.output
