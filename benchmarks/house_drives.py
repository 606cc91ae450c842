"""Drives of a robot without dynamics to everything that stands in a house, one after the other.

    python -m benchmarks.house_drives --robot r1pro
    python -m benchmarks.house_drives --houses generated:111,generated:112

On the prior map, from the middle of its largest free floor. Told are the fixtures that it reaches, the simulated and
the wall time, the greatest depth of its base in an obstacle, and why it does not reach the others.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import click
import numpy as np
from scipy import ndimage

from mpvi_bt.apps.cli.argument_types import Houses
from mpvi_bt.executive.plan.knowledge import Entry, KnowledgeBase
from mpvi_bt.finding.navigation.navigator import KnownPlaceNavigator, Trip
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Progress
from mpvi_bt.ground.robot.mobile_base import placed
from mpvi_bt.ground.robot.model import RobotModel
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Proprioception
from mpvi_bt.ground.robot.robots import ROBOTS, robot_named
from mpvi_bt.house.layout.house import House, load_house
from mpvi_bt.house.layout.prior_map import knowledge, prior_map
from mpvi_bt.runs.suite.suite_houses import suite_houses
from mpvi_bt.testing.doubles import KinematicRobot

_MOST_S = 200.0  # of one drive


class Driven(KinematicRobot):
    """A robot with its arms folded that moves as it is told."""

    def __init__(self, model: RobotModel, pose: Array) -> None:
        super().__init__()
        self._model, self._pose = model, pose.copy()

    def proprioception(self) -> Proprioception:
        """What it feels."""
        model = self._model
        return replace(super().proprioception(), robot=model.name, torso=model.travel_torso, arm=model.travel_arm)


class ToOne(KnownPlaceNavigator):
    """Takes a target for the entry of that name."""

    def _look_up(self, trip: Trip) -> tuple[list[Entry], str | None]:
        return [self._knowledge().entries[trip.target]], None


@click.command()
@click.option("--robot", type=click.Choice(list(ROBOTS)), default="r1", show_default=True)
@click.option(
    "--houses",
    type=Houses(),
    default="family_house",
    show_default=True,
    help="How many are drawn, or which, joined by commas.",
)
def main(robot: str, houses: int | tuple[str, ...]) -> None:
    """Drive, and print a line for each target that was not reached, one a house, and the sum."""
    model, total = robot_named(robot), Sum()
    for name in suite_houses(houses):
        came = drives(model, load_house(name))
        total.add(came)
        click.echo(f"{name}: {came}")
        for line in came.failures:
            click.echo(f"  {line}")
    click.echo(f"{model.name}: {total}")


@dataclass
class Sum:
    """What came of drives.

    Attributes:
        reached, tried: How many.
        simulated_s, wall_s: Of all.
        deepest_m: The deepest that the middle of a taken cell was within the base.
        failures: A line each.
    """

    reached: int = 0
    tried: int = 0
    simulated_s: float = 0.0
    wall_s: float = 0.0
    deepest_m: float = 0.0
    failures: list[str] = field(default_factory=list)

    def add(self, other: Sum) -> None:
        """With those of another house."""
        self.reached += other.reached
        self.tried += other.tried
        self.simulated_s += other.simulated_s
        self.wall_s += other.wall_s
        self.deepest_m = max(self.deepest_m, other.deepest_m)
        self.failures += other.failures

    def __str__(self) -> str:
        return (
            f"{self.reached} of {self.tried} reached in {self.simulated_s:.0f} s simulated, {self.wall_s:.0f} s wall; "
            f"its base at most {self.deepest_m * 100:.1f} cm in cells that are taken"
        )


def drives(model: RobotModel, house: House) -> Sum:
    """To every fixture of a house, one after the other."""
    grid_map, known = prior_map(house), KnowledgeBase({entry.name: entry for entry in knowledge(house)})
    taken = (np.argwhere(grid_map.occupied)[:, ::-1] + 0.5) * grid_map.resolution_m + grid_map.origin_m
    clearance = ndimage.distance_transform_edt(~grid_map.occupied & (grid_map.rooms >= 0))
    freest = np.unravel_index(np.argmax(clearance), clearance.shape)
    robot = Driven(model, np.array([*grid_map.center(int(freest[0]), int(freest[1])), 0.0]))
    came, began = Sum(), time.perf_counter()
    for name in (entry.name for entry in known if entry.kind == "fixture"):
        navigator = ToOne(robot, grid_map, known)
        navigator.start(name, None)
        for k in range(round(_MOST_S * CONTROL_HZ)):
            report = navigator.step()
            if report.progress is not Progress.RUNNING:
                break
            robot.advance(robot.action)
            came.simulated_s += 1 / CONTROL_HZ
            if k % 10 == 0:
                came.deepest_m = max(came.deepest_m, _depth(model, robot.proprioception().base_pose, taken))
        came.tried += 1
        came.reached += report.progress is Progress.SUCCEEDED
        if report.progress is not Progress.SUCCEEDED:
            came.failures.append(f"{name}: {report.reason or 'too long'}: {report.feedback}")
    came.wall_s = time.perf_counter() - began
    return came


def _depth(model: RobotModel, pose: Array, taken: Array) -> float:
    """How deep [m] the middle of an occupied cell is within the base's outline, at the most."""
    outline = placed(model.base.outline, pose)
    along = np.roll(outline, -1, 0) - outline
    inward = np.stack([-along[:, 1], along[:, 0]], 1) / np.hypot(*along.T)[:, None]
    near = taken[np.abs(taken - pose[:2]).max(1) < 1.0]
    return float((near @ inward.T - (outline * inward).sum(1)).min(1).max(initial=0.0))


if __name__ == "__main__":
    main()
