"""Laws of the pairs of episodes by labels and by learned eyes."""

from __future__ import annotations

from benchmarks.eyes.paired import HOUSES, columns, order, rows
from mpvi_bt.runs.choices.config import EpisodeConfig
from tests.synthetic_suites import synthetic_result

BOTH = ("mpvi", "mpvi_pixels")


def test_the_order_is_drawn_by_lot_and_leaves_nothing_out() -> None:
    """Own houses and drawn ones take turns; a seed draws one order."""
    drawn = order(57)
    assert drawn == order(57) != order(58)
    assert len(drawn) == len(set(drawn)) == 30 + 5 * len(HOUSES)
    assert [house is None for _, house in drawn[:6]] == [True, False] * 3


def test_what_one_method_has_not_played_is_in_no_row() -> None:
    """A row is a pair, of one task in one house; the last row has the means."""
    jobs = [
        ("picking_up_trash", None, BOTH),
        ("picking_up_trash", HOUSES[0], BOTH),
        ("turning_on_radio", None, BOTH[:1]),
    ]
    found = [
        synthetic_result(EpisodeConfig(task, house=house, method=method), share)
        for task, house, methods in jobs
        for method, share in zip(methods, (1.0, 0.0), strict=False)
    ]
    table = list(rows(found, BOTH))
    assert [row[:5] for row in table] == [
        ["`picking_up_trash`", "own", 0, 1.0, 0.0], ["`picking_up_trash`", HOUSES[0], 0, 1.0, 0.0],
        ["mean of 2", "", "", 1.0, 0.0],
    ]  # fmt: skip
    assert table[0][5]
    assert all(len(row) == len(columns(BOTH)) for row in table)
    assert list(rows([], BOTH)) == [["mean of 0", "", "", None, None, "", ""]]
