"""Tables in terminal columns: figures right-aligned, and no more of them than there is room for."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from mpvi_bt.executive.drawing.cells import columns

_GAP = "  "


def aligned(rows: Sequence[Sequence[str]], left: Collection[int] = ()) -> list[str]:
    """Each row as a line, every column as wide as it needs.

    Args:
        rows: As long as each other; the first may be the head.
        left: Columns of words, which begin where their head does. All others end where it does.
    """
    widths = [max(map(columns, column)) for column in zip(*rows, strict=True)]
    return [
        _GAP.join(
            cell + " " * (width - columns(cell)) if i in left else " " * (width - columns(cell)) + cell
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def fitting(rows: Sequence[Sequence[str]], optional: Sequence[int], width: int) -> list[int]:
    """The columns for which there is room.

    Args:
        rows: As of `aligned`.
        optional: Columns that may be left out, the most important first: there is none without those before it.
        width: Of the whole table.
    """
    needed = [len(_GAP) + max(map(columns, column)) for column in zip(*rows, strict=True)]
    shown = [i for i in range(len(needed)) if i not in optional]
    used = sum(needed[i] for i in shown) - len(_GAP)
    for i in optional:
        used += needed[i]
        if used > width:
            break
        shown.append(i)
    return sorted(shown)
