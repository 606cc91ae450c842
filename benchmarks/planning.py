"""Planning and timing of one arm's motions: ours side by side with libraries, on the same problems in one run.

    python benchmarks/planning.py [problems per scene]

Each problem is a scene of solids in the robot's frame, an arm, and a posture to reach; it counts only if start and goal
are free. All planners ask the same compiled collision check, at the same spacing, and have the same two seconds.
`ompl`, `ruckig` and `toppra` are compared where they are installed (pip install ompl ruckig toppra); none is needed.
"""

from __future__ import annotations

import importlib.util
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array, Solid, box
from mpvi_bt.ground.robot import timing
from mpvi_bt.ground.robot.arm_motion import plan
from mpvi_bt.ground.robot.arms import posture_distance
from mpvi_bt.ground.robot.collision import Body, Surroundings
from mpvi_bt.ground.robot.model import SIGN
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, SIDES, Side
from mpvi_bt.hands.robots import r1
from mpvi_bt.hands.robots.r1 import R1

LIMIT_S, MARGIN_M, CHECK_RAD = 2.0, 0.005, 0.07
Path = list[Array]


@dataclass(frozen=True, eq=False)
class Problem:
    """An arm, the robot among solids, and a free posture to reach."""

    scene: str
    side: Side
    body: Body
    goal: Array


def _table(rng: np.random.Generator) -> tuple[list[Solid], Array]:
    x, z = rng.uniform(0.62, 0.75), rng.uniform(0.70, 0.80)
    clutter = [
        box((x + rng.uniform(-0.2, 0.2), rng.uniform(-0.4, 0.4), z + h / 2), (rng.uniform(0.06, 0.16), 0.1, h))
        for h in rng.uniform(0.08, 0.3, 5)
    ]
    return [box((x, 0.0, z - 0.02), (0.6, 1.4, 0.04)), *clutter], np.array([x - 0.12, 0.18, z + 0.14])


def _shelf(rng: np.random.Generator) -> tuple[list[Solid], Array]:
    x, z = rng.uniform(0.62, 0.72), rng.uniform(0.75, 1.1)
    boards = [box((x, 0.0, z + h), (0.35, 1.2, 0.03)) for h in (-0.35, 0.0, 0.35)]
    return [*boards, box((x + 0.18, 0.0, z), (0.02, 1.2, 0.8))], np.array([x - 0.08, 0.15, z + 0.16])


def _cabinet(rng: np.random.Generator, width: float = 0.6, depth: float = 0.4, gap: float = 0.40) -> Any:
    x, z, y = rng.uniform(0.70, 0.78), rng.uniform(0.75, 1.0), rng.uniform(-0.1, 0.25)
    sides = [box((x, y + s * width / 2, z), (depth, 0.02, 0.9)) for s in (-1, 1)]
    boards = [box((x, y, z + h), (depth, width, 0.02)) for h in (-0.02, gap)]
    door = box((x - depth / 2 - width / 2, y - width / 2 - 0.05, z), (width, 0.03, 0.9))  # it stands open
    return [*sides, *boards, box((x + depth / 2, y, z), (0.02, width, 0.9)), door], np.array([x - 0.1, y, z + 0.18])


def _fridge(rng: np.random.Generator) -> tuple[list[Solid], Array]:
    return _cabinet(rng, width=0.7, depth=0.55, gap=0.30)


def _wall(rng: np.random.Generator) -> tuple[list[Solid], Array]:
    solids, at = _table(rng)
    beside = rng.uniform(0.36, 0.42) * rng.choice([-1, 1])
    return [*solids, box((0.4, float(beside), 1.0), (2.0, 0.04, 2.0))], at


SCENES = {"tabletop": _table, "shelf": _shelf, "cabinet": _cabinet, "fridge": _fridge, "wall": _wall}


def problems(per_scene: int) -> Iterator[Problem]:
    """The same problems in every run, as many of each scene."""
    for name, scene in SCENES.items():
        rng, found, tries = np.random.default_rng([7, len(name)]), 0, 0
        while found < per_scene and tries < 3000:
            tries += 1
            side = SIDES[found % 2]
            solids, at = scene(rng)
            torso = np.array([rng.uniform(0.2, 0.5), 0.0, rng.uniform(0.0, 0.5), 0.5])
            body = Body(R1, torso, dict(r1.TRAVEL_ARM), {}, Surroundings(solids))
            approach = (1.0, rng.uniform(-0.4, 0.4), rng.uniform(-1.0, 0.0))
            p = at * [1, SIGN[side], 1] + rng.uniform([-0.06, -0.12, -0.06], [0.06, 0.12, 0.06])
            T = kin.transform(kin.hand_rotation(approach, (0, 1, 0.2)), p)
            _, q = R1.arm_inverse(kin.inverse(R1.chest(torso)) @ T, side)
            q = q[body.free(side, q, MARGIN_M)] if len(q) else q
            if not len(q) or not body.trunk_free() or not body.free(side, r1.TRAVEL_ARM[side], MARGIN_M)[0]:
                continue
            found += 1
            yield Problem(name, side, body, q[posture_distance(q, r1.TRAVEL_ARM[side]).argmin()])


def ours(problem: Problem, seed: int) -> Path | None:
    """`arm_motion.plan`."""
    return plan(problem.body, problem.side, problem.goal, np.random.default_rng(seed), MARGIN_M, iterations=6000)


def with_ompl(planner: str) -> Callable[[Problem, int], Path | None]:
    """One of ompl's planners, its path shortened by its own simplifier."""
    from ompl import base, geometric, util

    util.setLogLevel(util.LogLevel.LOG_NONE)

    def solve(problem: Problem, seed: int) -> Path | None:
        util.RNG.setSeed(seed + 1) if hasattr(util.RNG, "setSeed") else None
        space = base.RealVectorStateSpace(7)
        bounds = base.RealVectorBounds(7)
        for j, (low, high) in enumerate(r1.ARM_LIMITS[problem.side]):
            bounds.setLow(j, float(low))
            bounds.setHigh(j, float(high))
        space.setBounds(bounds)
        setup = geometric.SimpleSetup(space)
        body, side = problem.body, problem.side

        def free(state: Any) -> bool:
            return bool(body.free(side, np.array([state[j] for j in range(7)]), MARGIN_M)[0])

        setup.setStateValidityChecker(free)
        information = setup.getSpaceInformation()
        information.setStateValidityCheckingResolution(CHECK_RAD / space.getMaximumExtent())
        start, goal = space.allocState(), space.allocState()
        for j in range(7):
            start[j], goal[j] = float(r1.TRAVEL_ARM[side][j]), float(problem.goal[j])
        setup.setStartAndGoalStates(start, goal)
        setup.setPlanner(getattr(geometric, planner)(information))
        setup.solve(LIMIT_S)
        if not setup.haveExactSolutionPath():
            return None
        if planner != "BITstar":
            setup.simplifySolution()
        return [np.array([state[j] for j in range(7)]) for state in setup.getSolutionPath().getStates()]

    return solve


def report(name: str, solve: Callable[[Problem, int], Path | None], tasks: list[Problem]) -> list[tuple[Problem, Path]]:
    """Print one planner's row; its paths."""
    seconds, found, touching = [], [], 0
    for seed, problem in enumerate(tasks):
        started = time.process_time()
        path = solve(problem, seed)
        seconds.append(time.process_time() - started)
        if path is not None:
            found.append((problem, path))
            fine = [a + (b - a) * np.linspace(0, 1, int(np.abs(b - a).max() / 0.01) + 2)[:, None]
                    for a, b in pairwise(path)]  # fmt: skip
            touching += not problem.body.free(problem.side, np.concatenate(fine), -0.005).all()
    length = [sum(float(np.abs(b - a).max()) for a, b in pairwise(path)) for _, path in found]
    moved = [len(timing.timed(path, r1.ARM_SPEED, r1.ARM_ACCELERATION)) / CONTROL_HZ for _, path in found]
    half, most = np.quantile(seconds, [0.5, 0.95]) * 1e3
    print(f"{name:20s} {len(found):4d}/{len(tasks)} {half:9.1f} {most:9.1f} {np.median(length):9.2f}"
          f" {np.median(moved):9.2f} {touching:9d}", flush=True)  # fmt: skip
    return found


def with_toppra(path: Path) -> float:
    """Duration [s] by toppra, along a spline through the path with its corners rounded as ours."""
    import toppra
    from toppra import algorithm, constraint

    fine = timing._fine(timing._rounded(np.asarray(path)))
    spline = toppra.SplineInterpolator(np.linspace(0, 1, len(fine)), fine)
    limits = [
        constraint.JointVelocityConstraint(np.stack([-r1.ARM_SPEED, r1.ARM_SPEED], 1)),
        constraint.JointAccelerationConstraint(np.stack([-r1.ARM_ACCELERATION, r1.ARM_ACCELERATION], 1)),
    ]
    trajectory = algorithm.TOPPRA(limits, spline).compute_trajectory()
    return float("nan") if trajectory is None else float(trajectory.duration)


def with_ruckig(path: Path) -> float:
    """Duration [s] by ruckig from corner to corner: its waypoints need a service on the network."""
    import ruckig

    total = 0.0
    for a, b in pairwise(path):
        given = ruckig.InputParameter(7)
        given.current_position, given.target_position = a.tolist(), b.tolist()
        given.max_velocity, given.max_acceleration = r1.ARM_SPEED.tolist(), r1.ARM_ACCELERATION.tolist()
        given.max_jerk = (r1.ARM_ACCELERATION * 6).tolist()  # what the moving average of ours comes to
        trajectory = ruckig.Trajectory(7)
        ruckig.Ruckig(7).calculate(given, trajectory)
        total += trajectory.duration
    return total


def ours_timed(path: Path) -> float:
    """Duration [s] by `timing.timed`."""
    return len(timing.timed(path, r1.ARM_SPEED, r1.ARM_ACCELERATION)) / CONTROL_HZ


def main() -> None:
    """Print both tables."""
    tasks = list(problems(int(sys.argv[1]) if len(sys.argv) > 1 else 20))
    print(", ".join(f"{sum(t.scene == name for t in tasks)} {name}" for name in SCENES))
    print(
        f"{'planner':20s} {'solved':>8s} {'median ms':>9s} {'p95 ms':>9s} {'rad':>9s} {'moving s':>9s} {'touching':>9s}"
    )
    ours(tasks[0], 0)  # compiled
    found = report("ours (RRT-Connect)", ours, tasks)
    if importlib.util.find_spec("ompl"):
        for planner in ("RRTConnect", "LBKPIECE1", "BITstar"):
            report(f"ompl {planner}", with_ompl(planner), tasks)
    print(f"\n{'timing':20s} {'median s':>9s} {'mean s':>9s} {'ms each':>9s} {'failed':>9s}")
    for name, timed in (("ours", ours_timed), ("toppra", with_toppra), ("ruckig", with_ruckig)):
        if name == "ours" or importlib.util.find_spec(name):
            timed(found[0][1])
            started = time.process_time()
            took = np.array([timed(path) for _, path in found])
            spent = (time.process_time() - started) / len(found)
            print(f"{name:20s} {np.nanmedian(took):9.2f} {np.nanmean(took):9.2f} {spent * 1e3:9.2f}"
                  f" {int(np.isnan(took).sum()):9d}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
