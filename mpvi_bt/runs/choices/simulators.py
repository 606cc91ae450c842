"""Optional simulators besides our own. Each is loaded when it is chosen."""

from __future__ import annotations

import importlib
import importlib.util
from typing import TYPE_CHECKING

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.extras import install
from mpvi_bt.ground.robot.default_robot import DEFAULT_ROBOT
from mpvi_bt.ground.robot.robots import ROBOTS, robot_named
from mpvi_bt.runs.choices.config import EpisodeConfig

if TYPE_CHECKING:
    from mpvi_bt.house.instances.sampling import Start
    from mpvi_bt.house.sim.world import SimWorld

_MANISKILL = "mpvi_bt.house.maniskill.env"  # stands above this part, which knows but its name


def check_simulator_choice(config: EpisodeConfig) -> None:
    """Raise UserError if an episode's simulator is not installed, or if it or what is recorded is not for its robot."""
    if config.sim == "maniskill" and importlib.util.find_spec("mani_skill") is None:
        raise UserError(f"--sim maniskill needs ManiSkill, which is not installed: {install('maniskill')}")
    robot = robot_named(config.robot)
    if config.sim != "sapien" and robot.name != DEFAULT_ROBOT:
        raise UserError(f"--robot {config.robot}: --sim {config.sim} runs trees with the {DEFAULT_ROBOT} only.")
    if len(robot.sides) < 2 and config.demonstration is not None:
        able = " and ".join(name for name, known in ROBOTS.items() if len(known.sides) == 2)
        raise UserError(f"--robot {config.robot}: --demonstration records with {able} only.")


def begin_elsewhere(config: EpisodeConfig, render: bool) -> tuple[SimWorld, Start]:
    """The start of an episode in ManiSkill's scene: as of `instances.begin`, but that steps are the environment's."""
    begun: tuple[SimWorld, Start] = importlib.import_module(_MANISKILL).begin_in_maniskill(
        config.task, config.instance, config.split, render=render, assisted=config.assisted, house=config.house
    )
    return begun
