"""What is remembered of what the hands have done, from one prompt to the next."""

import numpy as np

from mpvi_bt.finding.scene.hand_history import HandHistory

SHEET = np.array([[1.0, 1.0, 0.0], [1.4, 1.6, 0.02]])


def test_a_sheet_on_the_floor_bars_the_floor_until_it_is_taken_up() -> None:
    """It looks like floor: a second one was laid on top of it. What lies on a table bars no floor."""
    history, places = HandHistory(), np.array([[1.2, 1.3], [1.6, 1.3], [1.8, 1.3]])
    history.put_down("left", "book", SHEET + [0.0, 0.0, 0.7], dropped=False)
    assert not history.covered(places, 0.3).any()
    history.put_down("both", "sheet", SHEET, dropped=False)
    assert history.covered(places, 0.3).tolist() == [True, True, False]
    assert history.is_laid("sheet", SHEET.mean(0))
    history.take_up("sheet", SHEET.mean(0) + [0.03, 0.0, 0.0])
    assert not history.covered(places, 0.3).any()
