"""The rate of stepping the house with the robot driving, against a bare `scene.step()` loop over the same scene.

    python benchmarks/stepping.py

Both sides drive the same way: the bare loop repeats the drive targets that the last action left, four physics steps a
control step, and nothing else. The two alternate within one run, so that the machine's noise meets both.
"""

from __future__ import annotations

import statistics
import time

import numpy as np

from mpvi_bt.robot.protocol import ActionLayout
from mpvi_bt.sim.catalogue import load_catalogue
from mpvi_bt.sim.house import load_house
from mpvi_bt.sim.world import Placement, World

ROUNDS, STEPS, SUBSTEPS = 15, 60, 4


def main() -> None:
    """Print the control steps a second of both sides and their ratio."""
    catalogue = load_catalogue()
    can, T = catalogue["can_of_soda"], np.eye(4)
    T[:3, 3] = (12.0, 4.2, 0.001)
    world = World(load_house(), {"can": Placement(can, T)}, np.array([10.2, 2.6, 0.0]), render=False)
    world.settle()
    scene = world._scene  # the bare side of the comparison
    action = world.robot.action
    ours, bare = [], []
    for round_ in range(ROUNDS):
        direction = 1 if round_ % 2 else -1
        action[ActionLayout.BASE] = (0.25 * direction, 0.0, 0.4 * direction)
        started = time.perf_counter()
        for _ in range(STEPS):
            world.step(action)
        ours.append(STEPS / (time.perf_counter() - started))
        started = time.perf_counter()
        for _ in range(STEPS * SUBSTEPS):
            scene.step()
        bare.append(STEPS / (time.perf_counter() - started))
    ratios = [a / b for a, b in zip(ours, bare, strict=True)]
    print(f"driving through World.step   {statistics.median(ours):7.0f} control steps/s")
    print(f"bare scene.step(), driving   {statistics.median(bare):7.0f} control steps/s")
    print(f"ratio, median of {ROUNDS} rounds    {statistics.median(ratios):7.2f}")


if __name__ == "__main__":
    main()
