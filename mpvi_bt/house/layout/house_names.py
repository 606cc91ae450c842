"""Names of houses: of a file, or with the seed that one is drawn by."""

from __future__ import annotations

from mpvi_bt.ground import paths
from mpvi_bt.house.generated.house_kind import FOLDER as KINDS
from mpvi_bt.house.generated.seeded_name import seeded

FOLDER = "tasks/houses"


def check_house_name(house: str) -> None:
    """Raise UserError unless this names a house: its name, its file, or a kind and a seed."""
    if (drawn := seeded(house)) is None:
        paths.find_or_file(FOLDER, house, "house")
    else:
        paths.find(KINDS, drawn.kind, "kind of house")
