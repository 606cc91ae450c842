"""Houses of a suite: those that it names, or so many that are drawn by seeds."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np

from mpvi_bt.ground.errors import UserError
from mpvi_bt.house.generated.seeded_name import PREFIX
from mpvi_bt.house.instances.splits import Split, hidden_seed
from mpvi_bt.house.layout.house_names import check_house_name

MOST = 1000
_SEEDS = 10**9  # a name has nine digits for it


def read_houses(text: str) -> int | tuple[str, ...]:
    """How many houses "10" means, or which ones "family_house,generated:3".

    Raises:
        UserError: It is no such number, there is no such house, or one is named twice.
    """
    if text.isascii() and text.isdigit():
        if not 1 <= int(text) <= MOST:
            raise UserError(f"--houses: {text}: a suite has 1 to {MOST} houses.")
        return int(text)
    names = tuple(name.strip() for name in text.split(","))
    for i, name in enumerate(names):
        check_house_name(name)
        if name in names[:i]:
            raise UserError(f"--houses: {name} is given twice.")
    return names


def suite_houses(houses: int | Sequence[str], split: Split = "public") -> list[str]:
    """Names of the houses.

    Args:
        houses: Names, or how many are drawn: public ones have the seeds from 1 on, hidden ones seeds of the secret.
        split: Of the suite's instances.

    Raises:
        UserError: As of `hidden_seed`.
    """
    if not isinstance(houses, int):
        return list(houses)
    if split == "public":
        return [f"{PREFIX}{seed}" for seed in range(1, houses + 1)]
    # Slow to make: names of houses are in results, and nobody is to find the secret by trying.
    digest = hashlib.scrypt(hidden_seed().encode(), salt=b"houses", n=1 << 14, r=8, p=1, dklen=16)
    drawn = np.random.default_rng([*digest]).choice(_SEEDS, MOST, replace=False, shuffle=True)
    return [f"{PREFIX}{seed}" for seed in drawn[:houses]]
