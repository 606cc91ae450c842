"""States of many houses as tensors, one row an environment; and worlds of the core that follow the rows.

Physics on the GPU has no scene that the core could ask: a `Twin` of each house, on the CPU, stands as its row has it
and is judged by the core's own rules.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import sapien
import torch
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.utils.structs import Actor, Articulation
from numpy.typing import NDArray

from mpvi_bt.ground.robot.robots import model_named
from mpvi_bt.house.instances.instances import begin, expanded_problem, settled
from mpvi_bt.house.instances.sampling import Start
from mpvi_bt.house.instances.splits import Split
from mpvi_bt.house.instances.tasks import in_house, load_task
from mpvi_bt.house.layout.house import House, load_house
from mpvi_bt.house.sim.builder import Thing, build_house, build_object
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.things.catalogue import load_catalogue

_MOVED = 1e-4  # [m, rad] and of a quaternion: what moves less looks the same to goals
Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class BatchState:
    """How all that moves stands in some houses, with m free things, k joints of things and d of the robot.

    Attributes:
        poses: (n, m, 7) of the free things, x, y, z [m] and quaternion wxyz, in `StateLayout.free`'s order.
        joints: (n, k) [m, rad], as `StateLayout.joints` has them.
        robot: (n, d) in the order of `StateLayout.robot`.
    """

    poses: torch.Tensor
    joints: torch.Tensor
    robot: torch.Tensor

    def moved_since(self, before: BatchState | None) -> torch.Tensor:
        """(n,) whether any thing has moved since; the robot does not count. None: all have."""
        if before is None:
            return torch.ones(len(self.poses), dtype=torch.bool, device=self.poses.device)
        changes = torch.hstack([(self.poses - before.poses).flatten(1), self.joints - before.joints])
        return (changes.abs() > _MOVED).any(dim=1)

    def only(self, rows: torch.Tensor) -> BatchState:
        """These rows (r,)."""
        return BatchState(self.poses[rows], self.joints[rows], self.robot[rows])

    def replaced(self, rows: torch.Tensor, other: BatchState) -> BatchState:
        """The same with these rows (r,) as another one's r have it."""
        pairs = ((self.poses, other.poses), (self.joints, other.joints), (self.robot, other.robot))
        return BatchState(*(mine.index_copy(0, rows, theirs.to(mine)) for mine, theirs in pairs))

    def rows(self) -> list[tuple[Floats, Floats, Floats]]:
        """The three of each house, on the CPU."""
        return list(zip(*(t.cpu().numpy() for t in (self.poses, self.joints, self.robot)), strict=True))


class StateLayout:
    """What the numbers of a `BatchState` belong to.

    Attributes:
        free: Names of the things that move as a whole.
        joints: Name of each thing with doors, drawers or lids, to where its joints are.
        robot: Names of the robot's joints.
    """

    def __init__(self, things: Mapping[str, Thing], robot: Sequence[str]) -> None:
        """The layout of a house with `things`, and with a robot of joints of these names."""
        self.free = [name for name, thing in things.items() if thing.movable]
        self.joints: dict[str, slice] = {}
        count = 0
        for name, thing in things.items():
            if thing.articulation is not None:
                self.joints[name] = slice(count, count + thing.articulation.dof)
                count += thing.articulation.dof
        self.count, self.robot = count, list(robot)

    def standing(self, saved: Sequence[Mapping[str, Any]]) -> BatchState:
        """How worlds stood when `SimWorld.save` told of them, their robots' joints by name under "joints"."""
        poses = [[world["things"][name]["pose"] for name in self.free] for world in saved]
        joints = [[q for name in self.joints for q in world["things"][name]["q"]] for world in saved]
        robots = [[world["joints"][name] for name in self.robot] for world in saved]
        shapes = ((len(self.free), 7), (self.count,), (len(self.robot),))
        values = (torch.tensor(v, dtype=torch.float32) for v in (poses, joints, robots))
        return BatchState(*(v.reshape(len(saved), *shape) for v, shape in zip(values, shapes, strict=True)))


class Twin(SimWorld):
    """A CPU copy of one house of the batch. Its physics only computes contacts."""

    def follow(self, layout: StateLayout, poses: Floats, joints: Floats, robot: Floats) -> None:
        """Take the poses (m, 7), joints (k,) and robot (d,) of a `BatchState` row, and find contacts."""
        motions: dict[str, dict[str, list[float]]] = {}
        for name, pose in zip(layout.free, poses.tolist(), strict=True):
            motions[name] = {"pose": pose, "root_v": [0.0] * 6, "v": [0.0] * 6}
        for name, place in layout.joints.items():
            q = joints[place].tolist()
            motions[name] = motions.get(name, {}) | {"q": q, "v": [0.0] * len(q)}
        q = dict(zip(layout.robot, robot.tolist(), strict=True))
        angles = np.array([q[joint.name] for joint in self.robot.articulation.active_joints], np.float32)
        self._pose(motions, angles)
        self.refresh()
        self._pose(motions, angles)  # finding contacts takes a step of physics, which has moved things a little

    def _pose(self, motions: Mapping[str, Mapping[str, list[float]]], q: Floats) -> None:
        for name, motion in motions.items():
            self._things[name].set_motion(motion)
        self.robot.articulation.set_qpos(q)
        self.robot.articulation.set_qvel(np.zeros_like(q))
        self.robot.forget()


class Batch:
    """Reads and places what moves in all houses of a ManiSkill scene."""

    def __init__(
        self,
        scene: ManiSkillScene,
        layout: StateLayout,
        views: Mapping[str, Actor | Articulation],
        robot: Articulation,
    ) -> None:
        """Take what ManiSkill knows of the things, and the robots."""
        self._scene, self.layout, self._views, self.robot = scene, layout, views, robot

    def poses(self) -> torch.Tensor:
        """(n, m, 7) of the free things, x, y, z [m] and quaternion wxyz."""
        return self._stacked([self._views[name].pose.raw_pose[:, None] for name in self.layout.free], (0, 7))

    def joints(self) -> torch.Tensor:
        """(n, k) of all doors, drawers and lids [m, rad]."""
        return self._stacked([self._views[name].get_qpos() for name in self.layout.joints], (0,))

    def read(self) -> BatchState:
        """How everything stands now."""
        return BatchState(self.poses(), self.joints(), self.robot.get_qpos())

    def put(self, standing: BatchState) -> None:
        """Have the houses that ManiSkill resets stand so, all at rest; `standing` has a row for each, ascending."""
        rows = self._scene._reset_mask
        still = torch.zeros((len(standing.poses), 6), device=self._scene.device)
        poses = {name: standing.poses[:, i].to(still) for i, name in enumerate(self.layout.free)}
        for name, view in self._views.items():
            if name not in poses and name not in self.layout.joints:
                continue
            root = poses.get(name, view.initial_pose.raw_pose.to(still)[rows] if name not in poses else None)
            parts = [root, still]
            if name in self.layout.joints:
                q = standing.joints[:, self.layout.joints[name]].to(still)
                parts += [q, torch.zeros_like(q)]
            view.set_state(torch.hstack(parts))
        q = standing.robot.to(still)
        self.robot.set_qpos(q)
        self.robot.set_qvel(torch.zeros_like(q))

    def _stacked(self, parts: list[torch.Tensor], empty: tuple[int, ...]) -> torch.Tensor:
        """Tensors beside each other, a row an environment."""
        n = self._scene.num_envs
        return torch.cat(parts, dim=1) if parts else torch.zeros((n, *empty), device=self._scene.device)


@dataclass(frozen=True, eq=False)
class Begun:
    """How an instance of a task begins in the core.

    Attributes:
        start: Where things and robot are before they come to rest.
        saved: `SimWorld.save` once they have, with "joints", each of the robot's joints by its name.
    """

    start: Start
    saved: Mapping[str, Any]


@cache
def begun(task: str, instance: int, split: Split, robot: str = "r1", named: str | None = None) -> Begun:
    """How an instance begins, as of `instances.instances.begin`, with the robot of that name in the r1's place.

    Args:
        task, instance, split, robot: As of the environment.
        named: The house, if it is not the task's own.
    """
    known = in_house(load_task(task), named)
    house = load_house(known.house)
    problem = expanded_problem(known, house)
    world, start = begin(known, house, load_catalogue(), problem, instance, split, render=False)
    if robot != world.robot.model.name:
        world, _ = settled(house, start, render=False, robot=model_named(robot))
    saved = world.save()
    names = [joint.name for joint in world.robot.articulation.active_joints]
    return Begun(start, {**saved, "joints": dict(zip(names, saved["robot"]["q"], strict=True))})


def twin(house: House, began: Begun, robot: str) -> Twin:
    """A house that stands as an instance begins."""
    made = Twin(house, began.start.objects, began.start.base_pose, render=False, robot=model_named(robot))
    made.restore(began.saved)
    made.refresh()
    return made


def furnish(scene: sapien.Scene, house: House, start: Start, visible: bool) -> dict[str, Thing]:
    """Build house and things in a sub scene, as `SimWorld` does: things by name."""
    things = build_house(scene, house, visible)
    return things | {n: build_object(scene, p.entry, n, p.T_world, visible) for n, p in start.objects.items()}
