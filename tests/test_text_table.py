"""Tables in terminal columns."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.executive.drawing.cells import columns
from mpvi_bt.executive.drawing.text_table import aligned, fitting

CELL = st.text("ab0\N{SNOWMAN}\N{CJK UNIFIED IDEOGRAPH-4E00}", max_size=9)
ROWS = st.integers(1, 6).flatmap(lambda n: st.lists(st.lists(CELL, min_size=n, max_size=n), min_size=1))


@given(ROWS, st.sets(st.integers(0, 5)))
def test_columns_are_in_line(rows: list[list[str]], left: set[int]) -> None:
    """Whatever the letters: figures end, and words begin, in the same terminal column of every row."""
    widths = [max(columns(row[i]) for row in rows) for i in range(len(rows[0]))]
    for row, line in zip(rows, aligned(rows, left), strict=True):
        padded = [
            cell + " " * (width - columns(cell)) if i in left else " " * (width - columns(cell)) + cell
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        assert line == "  ".join(padded).rstrip()


@given(ROWS, st.integers(0, 60))
def test_what_fits_is_shown(rows: list[list[str]], width: int) -> None:
    """The first column always; of the others as many in order as there is room for."""
    optional = range(1, len(rows[0]))
    shown = fitting(rows, optional, width)
    assert shown == list(range(len(shown)))
    needed = [max(columns(row[i]) for row in rows) + 2 for i in range(len(rows[0]))]
    assert len(shown) == 1 or sum(needed[: len(shown)]) - 2 <= width
    assert len(shown) == len(needed) or sum(needed[: len(shown) + 1]) - 2 > width
