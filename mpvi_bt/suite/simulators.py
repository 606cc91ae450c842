"""Simulators other than the core's own, which an episode may be run in: extras that load where they are chosen."""

from __future__ import annotations

import importlib
import importlib.util
from typing import TYPE_CHECKING

from mpvi_bt.errors import UserError
from mpvi_bt.suite.config import EpisodeConfig

if TYPE_CHECKING:
    from mpvi_bt.sim.sampling import Start
    from mpvi_bt.sim.world import World

_MANISKILL = "mpvi_bt.sim.maniskill"  # stands above this part, which knows but its name


def check_simulator_choice(config: EpisodeConfig) -> None:
    """Raise UserError if the simulator of an episode is not installed."""
    if config.sim == "maniskill" and importlib.util.find_spec("mani_skill") is None:
        raise UserError("--sim maniskill needs ManiSkill, which is not installed: pip install 'mpvi_bt[maniskill]'")


def begin_elsewhere(config: EpisodeConfig, render: bool) -> tuple[World, Start]:
    """The start of an episode in ManiSkill's scene: as of `instances.begin`, but that steps are the environment's."""
    begun: tuple[World, Start] = importlib.import_module(_MANISKILL).begin_in_maniskill(
        config.task, config.instance, config.split, render=render, assisted=config.assisted
    )
    return begun
