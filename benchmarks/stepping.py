"""What a control step costs: against a bare `scene.step()` loop over the same scene, and what navigation adds to it.

    python -m benchmarks.stepping

Both sides of the first drive the same way: the bare loop repeats the drive targets that the last action left, four
physics steps a control step, and nothing else. The two alternate within one run, so that the machine's noise meets
both. For the second the robot drives through the house; planning and following are timed against stepping the world,
step by step in turn. A first round, which loads what is compiled, does not count. Then it searches the house for
things, with a map and without: what looking, mapping and planning add, what rendering adds, and how many pictures a
second of wall time that makes. Last, at the start of tasks with few rules and with many, the robot rests or turns: what
the rules of heat, blades and marks add, with and without them in turn.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Sequence

import numpy as np

from benchmarks.searches.play import Job, play
from mpvi_bt.finding.navigation.navigator import KnownPlaceNavigator
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.protocols import Progress
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.house.instances.instances import begin, expanded_problem
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.house.layout.house import load_house
from mpvi_bt.house.layout.prior_map import prior_map
from mpvi_bt.house.sim.world import Placement, SimWorld
from mpvi_bt.house.things.catalogue import load_catalogue
from tests.layouts import BASE

ROUNDS, STEPS, SUBSTEPS = 15, 60, 4
DRIVES, TARGETS = 3, ("kitchen", "can of soda", "bathroom", "bedroom", "garage", "utility room")
SEARCHES = (20, 22, 24)  # seeds; any do but those of the final table
# Tasks, and what is on in them: without heat and marks; marks, blades and what may become; heat at work.
RULED: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("picking_up_trash", ()),
    ("assembling_gift_baskets", ()),
    ("clean_a_patio", ()),
    ("wash_dog_toys", ("washer_1",)),
    ("make_pizza", ("oven_1",)),
    ("setting_the_fire", ("cigar_lighter.n.01_1",)),
)


def main() -> None:
    """Print all parts."""
    catalogue = load_catalogue()
    can, T = catalogue["can_of_soda"], np.eye(4)
    T[:3, 3] = (12.0, 4.2, 0.001)
    house = load_house()
    world = SimWorld(house, {"can": Placement(can, T)}, np.array([9.5, 3.5, 0.0]), render=False)
    world.settle()
    against_bare(world)
    driving(world, prior_map(house))
    play(Job(SEARCHES[0]))
    for given in ("prior", "online"):
        searching(given)
    for name, on in RULED:
        for turning_rad_s in (0.0, 0.4):
            ruled(name, on, turning_rad_s)


def against_bare(world: SimWorld) -> None:
    """The rate of both loops and their ratio."""
    scene = world._scene  # the bare side of the comparison
    action = world.robot.action
    ours, bare = [], []
    for round_ in range(ROUNDS):
        direction = 1 if round_ % 2 else -1
        action[BASE] = (0.25 * direction, 0.0, 0.4 * direction)
        started = time.perf_counter()
        for _ in range(STEPS):
            world.robot.act(action)
            world.step()
        ours.append(STEPS / (time.perf_counter() - started))
        started = time.perf_counter()
        for _ in range(STEPS * SUBSTEPS):
            scene.step()
        bare.append(STEPS / (time.perf_counter() - started))
    ratios = [a / b for a, b in zip(ours, bare, strict=True)]
    print(f"driving through SimWorld.step   {statistics.median(ours):7.0f} control steps/s")
    print(f"bare scene.step(), driving   {statistics.median(bare):7.0f} control steps/s")
    print(f"ratio, median of {ROUNDS} rounds    {statistics.median(ratios):7.2f}")


def driving(world: SimWorld, grid_map: OccupancyMap) -> None:
    """What driving from room to room adds to the cost of stepping."""
    navigator = KnownPlaceNavigator(world.robot, grid_map, world.knowledge)
    shares, plans = [], []
    for round_ in range(DRIVES):
        for target in TARGETS:
            navigating = stepping = 0.0
            navigator.start(target, None)
            while True:
                started = time.perf_counter()
                report = navigator.step()
                driven = time.perf_counter()
                if report.progress is not Progress.RUNNING:
                    break
                world.step()
                stepped = time.perf_counter()
                plans += [driven - started] if not stepping else []
                navigating, stepping = navigating + driven - started, stepping + stepped - driven
            if report.progress is not Progress.SUCCEEDED:
                raise SystemExit(f"the drive to {target!r} failed: {report}")
            shares += [navigating / stepping] if round_ else []
    print(f"driving, of the cost of stepping, median of {len(shares)} drives    {statistics.median(shares):8.1%}")
    print(f"of that the first step of a drive, which plans     {1e3 * statistics.median(plans):6.1f} ms")


def searching(given: str) -> None:
    """What searches with a map ("prior" or "online") add to the cost of stepping."""
    rows = [play(Job(seed, given)) for seed in SEARCHES]
    steps = sum(round(row.simulated_s * CONTROL_HZ) for row in rows)
    total = {key: sum(row.wall_s[key] for row in rows) for key in ("stepping", "navigation", "rendering")}
    pictures = sum(row.pictures for row in rows)
    print(
        f"searching, map {given}, {len(rows)} searches: stepping       {1e3 * total['stepping'] / steps:6.2f} ms a step"
    )
    print(f"  navigation, of the cost of stepping              {total['navigation'] / total['stepping']:8.1%}")
    print(f"  rendering, of the cost of stepping               {total['rendering'] / total['stepping']:8.1%}")
    print(f"  pictures a second of wall time, all told         {pictures / sum(total.values()):6.1f}")
    print(f"  navigation for each picture                      {1e3 * total['navigation'] / pictures:6.2f} ms")


def ruled(name: str, on: Sequence[str], turning_rad_s: float) -> None:
    """What rules add to a control step at the start of a task, in turn with and without all of them but switches.

    Args:
        name: The task.
        on: What is switched on.
        turning_rad_s: The base turns to and fro at this rate; at 0 nothing moves, and physics has least to do.
    """
    task = load_task(name)
    house = load_house(task.house)
    world, _ = begin(task, house, load_catalogue(), expanded_problem(task, house), 0, render=False)
    for switched in on:
        world.turn(switched, on=True)
    action, rules = world.robot.action, world.stepped

    def switches() -> None:
        world._switches.step(world.robot.hands_world(), world.robot.fingertips_world)

    costs: dict[bool, list[float]] = {True: [], False: []}
    for round_ in range(ROUNDS):
        for all_of_them in (True, False):
            world.stepped = rules if all_of_them else switches  # type: ignore[method-assign]
            action[BASE] = (0.0, 0.0, turning_rad_s * (1 if (round_ + all_of_them) % 2 else -1))
            started = time.process_time()
            for _ in range(STEPS):
                world.robot.act(action)
                world.step()
            costs[all_of_them].append((time.process_time() - started) / STEPS)
    ratio = statistics.median(a / b for a, b in zip(costs[True], costs[False], strict=True))
    label = f"{'turning' if turning_rad_s else 'resting'}, {name}" + "".join(f", {switched} on" for switched in on)
    print(f"{label:60} {1e3 * statistics.median(costs[True]):6.2f} ms a step, {ratio:5.3f} of that without rules")


if __name__ == "__main__":
    main()
