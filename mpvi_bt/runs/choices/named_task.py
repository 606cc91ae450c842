"""Tasks and houses that a run names. The house loads when one is named, not before."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mpvi_bt.house.instances.tasks import Task


def task_named(given: str) -> Task:
    """The task of that name or file. Raises UserError or FileProblems as `load_task` does."""
    from mpvi_bt.house.instances.tasks import load_task

    return load_task(given)


def rooms_of(house: str) -> Collection[str]:
    """The rooms of a house, by its name or file. Raises UserError or FileProblems as `load_house` does."""
    from mpvi_bt.house.layout.house import load_house

    return load_house(house).rooms
