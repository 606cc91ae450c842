"""Steps a second of the core and of its ManiSkill environment, in the same start of the same task.

    python -m benchmarks.maniskill
    python -m benchmarks.maniskill --cameras 0 --rounds 3

The core's world, the environment without observations and rewards, and with both ("state", "q_increment") take turns
within one run, round by round, so that the machine's noise meets all: idle, driving, and with both arms moving. Then
the same with three cameras in every step. Rates are of processor time, which others on the machine disturb least.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable, Mapping

import gymnasium
import numpy as np

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.hands.robots import r1
from mpvi_bt.house.instances.instances import begin, expanded_problem
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.house.layout.house import load_house
from mpvi_bt.house.maniskill.env import MpviHouseEnv
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.things.catalogue import load_catalogue
from tests.layouts import ACTION_SIZE, BASE, LAYOUT

TASK, INSTANCE = "picking_up_trash", 0
Step = Callable[[Array], object]


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--steps", type=int, default=60, help="of a round")
    parser.add_argument("--cameras", type=int, default=10, help="steps of a round with cameras; 0: none")
    given = parser.parse_args()
    world = core(render=False)

    def play(action: Array) -> None:
        world.robot.act(action)
        world.step()

    blind: dict[str, Step] = {
        "core": play,
        "ManiSkill, no observation": environment("none", "none").step,
        "ManiSkill, state and reward": environment("state", "q_increment").step,
    }
    table(blind, given.rounds, given.steps)
    if given.cameras:
        seeing = core(render=True)

        def look(action: Array) -> None:
            seeing.robot.act(action)
            seeing.step()
            for camera in r1.CAMERAS:
                seeing.robot.look(camera)

        print("\nwith three cameras, color and depth, in every step")
        table({"core": look, "ManiSkill, rgbd": environment("rgbd", "none").step}, given.rounds, given.cameras)


def core(render: bool) -> SimWorld:
    """The start in the core."""
    task = load_task(TASK)
    house = load_house(task.house)
    return begin(task, house, load_catalogue(), expanded_problem(task, house), INSTANCE, render=render)[0]


def environment(obs_mode: str, reward_mode: str) -> MpviHouseEnv:
    """The start in an environment."""
    made = gymnasium.make("MpviHouse-v1", task=TASK, instance=INSTANCE, obs_mode=obs_mode, reward_mode=reward_mode)
    env = made.unwrapped
    assert isinstance(env, MpviHouseEnv)
    return env


def table(sides: Mapping[str, Step], rounds: int, steps: int) -> None:
    """Run all sides in turn and print the median rate of each activity, and its ratio to the first side's."""
    activities: dict[str, Callable[[int], Array]] = {"idle": idle, "driving": driving, "manipulating": manipulating}
    print(f"{'control steps a second':<30}" + "".join(f"{name:>22}" for name in activities))
    rates: dict[tuple[str, str], list[float]] = {(s, a): [] for s in sides for a in activities}
    for round_ in range(rounds + 1):
        for activity, command in activities.items():
            for side, step in sides.items():
                actions = [command(k) for k in range(steps)]
                began = time.process_time()
                for action in actions:
                    step(action)
                rate = steps / (time.process_time() - began)
                rates[side, activity] += [rate] if round_ else []  # the first loads what is compiled
    first = next(iter(sides))
    for side in sides:
        cells = []
        for activity in activities:
            ratio = statistics.median(a / b for a, b in zip(rates[side, activity], rates[first, activity], strict=True))
            cells.append(f"{statistics.median(rates[side, activity]):14.0f} ({ratio:4.2f})")
        print(f"{side:<30}" + "".join(f"{cell:>22}" for cell in cells))


def idle(k: int) -> Array:
    """(23,) as the robot begins."""
    action = np.zeros(ACTION_SIZE)
    action[LAYOUT.torso] = r1.TRAVEL_TORSO
    for side, part in LAYOUT.arm.items():
        action[part] = r1.TRAVEL_ARM[side]
        action[LAYOUT.gripper[side]] = 1.0
    return action


def driving(k: int) -> Array:
    """(23,) turning on the spot, back and forth, and a little ahead and back."""
    action, way = idle(k), np.sign(np.sin(2 * np.pi * k / CONTROL_HZ))
    action[BASE] = (0.2 * way, 0.0, 0.5 * way)
    return action


def manipulating(k: int) -> Array:
    """(23,) both arms and the fingers moving."""
    action, wave = idle(k), np.sin(2 * np.pi * k / CONTROL_HZ)
    for side, part in LAYOUT.arm.items():
        action[part] += 0.1 * wave
        action[LAYOUT.gripper[side]] = wave
    return action


if __name__ == "__main__":
    main()
