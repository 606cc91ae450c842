"""Tasks and houses that a run names. The house loads when one is named, not before."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mpvi_bt.house.instances.tasks import Task
    from mpvi_bt.runs.choices.config import EpisodeConfig


def task_named(given: str) -> Task:
    """The task of that name or file. Raises UserError or FileProblems as `load_task` does."""
    from mpvi_bt.house.instances.tasks import load_task

    return load_task(given)


def task_of(config: EpisodeConfig) -> Task:
    """The task of an episode, in the house that it is played in.

    Raises:
        UserError: There is no such task or house, or the house lacks what the task needs.
        FileProblems: As of `load_task` and `load_house`.
    """
    from mpvi_bt.house.instances.tasks import in_house

    return in_house(task_named(config.task), config.house)


def rooms_of(house: str) -> Collection[str]:
    """The rooms of a house, by its name or file. Raises UserError or FileProblems as `load_house` does."""
    from mpvi_bt.house.layout.house import load_house

    return load_house(house).rooms
