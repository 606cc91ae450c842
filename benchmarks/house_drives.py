"""Drives of a robot without dynamics to everything that stands in the house, one after the other.

    python -m benchmarks.house_drives --robot r1pro

On the prior map: to how many it gets, in which simulated and wall time, how deep its base was in anything at the worst;
and why it does not get to the others.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np

from mpvi_bt.executive.plan.knowledge import Entry, KnowledgeBase
from mpvi_bt.finding.navigation.navigator import KnownPlaceNavigator, Trip
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Progress
from mpvi_bt.ground.robot.mobile_base import placed
from mpvi_bt.ground.robot.model import RobotModel
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Proprioception
from mpvi_bt.ground.robot.robots import ROBOTS, robot_named
from mpvi_bt.house.layout.house import load_house
from mpvi_bt.house.layout.prior_map import knowledge, prior_map
from mpvi_bt.testing.doubles import KinematicRobot

_MOST_S = 200.0  # of one drive
_START = np.array([5.0, 3.0, 0.0])


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


def main() -> None:
    """Drive, and print a line for each target that was not reached, and the sum."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--robot", choices=list(ROBOTS), default="r1")
    model = robot_named(parser.parse_args().robot)
    house = load_house()
    grid_map, known = prior_map(house), KnowledgeBase({entry.name: entry for entry in knowledge(house)})
    taken = (np.argwhere(grid_map.occupied)[:, ::-1] + 0.5) * grid_map.resolution_m + grid_map.origin_m
    names = [entry.name for entry in known if entry.kind == "fixture"]
    robot, began, reached, steps, deepest = Driven(model, _START), time.perf_counter(), 0, 0, 0.0
    for name in names:
        navigator = ToOne(robot, grid_map, known)
        navigator.start(name, None)
        for k in range(round(_MOST_S * CONTROL_HZ)):
            report = navigator.step()
            if report.progress is not Progress.RUNNING:
                break
            robot.advance(robot.action)
            steps += 1
            if k % 10 == 0:
                deepest = max(deepest, _depth(model, robot.proprioception().base_pose, taken))
        if report.progress is Progress.SUCCEEDED:
            reached += 1
        else:
            print(f"{name}: {report.reason or 'too long'}")
    print(
        f"{model.name}: {reached} of {len(names)} reached in {steps / CONTROL_HZ:.0f} s simulated, "
        f"{time.perf_counter() - began:.0f} s wall; its base at most {deepest * 100:.1f} cm in cells that are taken"
    )


def _depth(model: RobotModel, pose: Array, taken: Array) -> float:
    """How deep [m] the middle of an occupied cell is within the base's outline, at the most."""
    outline = placed(model.base.outline, pose)
    along = np.roll(outline, -1, 0) - outline
    inward = np.stack([-along[:, 1], along[:, 0]], 1) / np.hypot(*along.T)[:, None]
    near = taken[np.abs(taken - pose[:2]).max(1) < 1.0]
    return float((near @ inward.T - (outline * inward).sum(1)).min(1).max(initial=0.0))


if __name__ == "__main__":
    main()
