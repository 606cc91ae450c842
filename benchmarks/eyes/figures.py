"""Tables of what eyes saw, as files for `benchmarks.tables`."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from benchmarks.eyes.seen import SIZES, Seen, SeenSegment, SeenThing, is_movable
from benchmarks.tables import Cell, Column, Run, Table

BINS = 10
LEAST_THINGS = 15  # a kind of fewer things has no row
SURE = 0.5  # a score from which a segment counts as sure


def by_size(seen: Seen, runs: Sequence[Run]) -> Table:
    """Recall and precision by area, of movable things and of what stays where it is."""
    rows: list[tuple[Cell, ...]] = []
    for what, movable in (("things", True), ("furniture, floor, robot", False)):
        for low, high in zip(SIZES, (*SIZES[1:], 10**9), strict=True):
            things = [t for t in seen.things if is_movable(t.kind) is movable and low <= t.area < high]
            segments = [s for s in seen.segments if is_movable(s.kind) is movable and low <= s.area < high]
            label = f"{low} to {high - 1} px" if high < 10**9 else f"{low} px and more"
            rows.append((what, label, *_cells(things, segments)))
    columns = [Column(head=head) for head in ("of", "area")]
    heads = ("there", "outlined", "found", "segments", "right", "right of sure ones")
    columns += [Column(head=head, format=".0%" if k in (1, 2, 4, 5) else "d") for k, head in enumerate(heads)]
    return Table(kind="table", runs=tuple(runs), columns=tuple(columns), rows=tuple(rows))


def by_draw(seen: Seen, runs: Sequence[Run]) -> Table:
    """Recall of movable things by how they were drawn."""
    names = {
        "catalogue": "as in the catalogue",
        "trained": "sizes and colors as in training",
        "held_out_shape": "held-out shapes",
        "held_out_color": "held-out colors of ten kinds",
    }
    rows: list[tuple[Cell, ...]] = []
    for drawn, label in names.items():
        things = [t for t in seen.things if t.drawn == drawn and is_movable(t.kind)]
        large = [t for t in things if t.area >= SIZES[2]]
        rows.append((label, len(things), _share(things, lambda t: t.outlined), _share(things, lambda t: t.found),
                     _share(large, lambda t: t.found)))  # fmt: skip
    heads = ("there", "outlined", "found", f"found of those of {SIZES[2]} px and more")
    columns = [Column(head="things"), *(Column(head=h, format="d" if k == 0 else ".0%") for k, h in enumerate(heads))]
    return Table(kind="table", runs=tuple(runs), columns=tuple(columns), rows=tuple(rows))


def by_score(seen: Seen, runs: Sequence[Run]) -> Table:
    """How many of the segments of a score are right."""
    rows: list[tuple[Cell, ...]] = []
    for k in range(BINS):
        part = [s for s in seen.segments if k <= min(int(s.score * BINS), BINS - 1) < k + 1]
        mean = float(np.mean([s.score for s in part])) if part else None
        rows.append((f"{k / BINS:.1f} to {(k + 1) / BINS:.1f}", len(part), mean, _share(part, lambda s: s.right)))
    columns = (Column(head="score"), Column(head="segments", format="d"), Column(head="mean score", format=".2f"),
               Column(head="right", format=".2f"))  # fmt: skip
    return Table(kind="table", runs=tuple(runs), columns=columns, rows=tuple(rows))


def by_kind(seen: Seen, runs: Sequence[Run]) -> Table:
    """Recall and precision of each kind that there is enough of."""
    rows: list[tuple[Cell, ...]] = [
        (f"`{kind}`", there, found / there, segments, right / segments if segments else None)
        for kind, (there, found, segments, right) in seen.by_kind().items()
        if there >= LEAST_THINGS
    ]
    columns = (Column(head="kind"), Column(head="there", format="d"), Column(head="found", format=".0%"),
               Column(head="segments", format="d"), Column(head="right", format=".0%"))  # fmt: skip
    return Table(kind="table", runs=tuple(runs), columns=columns, rows=tuple(rows))


def _cells(things: Sequence[SeenThing], segments: Sequence[SeenSegment]) -> tuple[Cell, ...]:
    sure = [s for s in segments if s.score >= SURE]
    return (len(things), _share(things, lambda t: t.outlined), _share(things, lambda t: t.found), len(segments),
            _share(segments, lambda s: s.right), _share(sure, lambda s: s.right))  # fmt: skip


def _share(of: Sequence[SeenThing] | Sequence[SeenSegment], good: Callable[..., bool]) -> float | None:
    return float(np.mean([good(one) for one in of])) if of else None
