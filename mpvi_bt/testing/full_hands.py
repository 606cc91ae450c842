"""Puts things into the robot's hands before an episode or a test begins, gripped as the skills grip: by friction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mpvi_bt.ground.errors import BackendError
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.rays import interval
from mpvi_bt.ground.geometry.solids import Array, Solid, pose
from mpvi_bt.ground.robot.arms import posture_distance
from mpvi_bt.ground.robot.collision import Body, Load, Obstacles
from mpvi_bt.ground.robot.model import SIGN, RobotModel
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, SIDES, Side
from mpvi_bt.hands.stance.grasps import grasps
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.truth.true_scene import TrueScene

_CLOSING_S = 1.0
_NEAR_M = 1.7  # what is farther off is in nobody's way
# Where the underside of a thing may be carried, x, y toward the own side, z [m] and its turn [rad], the best first.
_PLACES = [
    (x, y, z, yaw)
    for x in (0.40, 0.45, 0.35, 0.50)
    for y in (0.16, 0.22, 0.30, 0.10)
    for z in (0.75, 0.85, 0.65, 0.55)
    for yaw in (0.0, 1.57, 0.8, -0.8)
]


def put_in_hands(world: SimWorld, held: Mapping[Side, str]) -> None:
    """Have the hands hold things, upright, before the chest.

    Raises:
        BackendError: A thing does not fit into its hand, or falls out of it, or the robot is one of a file.
    """
    if not held:
        return
    robot = world.robot.model
    if not isinstance(robot, RobotModel):
        raise BackendError(f"{robot.name} has no grasps of ours: only r1 and r1pro can hold things at the start")
    felt = world.robot.proprioception()
    T_world_base = kin.base(felt.base_pose)
    arms = {s: felt.arm[s] for s in SIDES}
    loads: dict[Side, Load] = {}
    poses: dict[Side, Array] = {}
    around = TrueScene(world).obstacles(T_world_base[:2, 3], _NEAR_M, set(held.values())).seen_from(T_world_base)
    for side, name in held.items():
        poses[side], arms[side], loads[side] = _posture(world, robot, T_world_base, side, name, arms, loads, around)
    world.robot.stand(arms)
    action = world.robot.action
    for side in held:
        action[robot.layout.gripper[side]] = -1.0
    for fixed in (True, False):
        for side, name in held.items():
            world.place(name, poses[side], fixed=fixed)
        for _ in range(round(_CLOSING_S * CONTROL_HZ)):
            world.robot.act(action)
            world.step()
    world.steps = 0
    for side, name in held.items():
        if name not in world.pinched(side):
            raise BackendError(f"{name} fell out of the {side} hand that was to hold it at the start")


def fill(world: SimWorld, filled: Mapping[str, Sequence[str]]) -> None:
    """Drop things into vessels, one after the other.

    Raises:
        BackendError: One of them did not stay inside.
    """
    for vessel, names in filled.items():
        for k, name in enumerate(names):
            volume = max(world.volumes(vessel), key=lambda v: float(np.prod(v.half_m)))
            middle = volume.T[:3, 3].copy()
            aside = 0.3 * float(volume.half_m[:2].min())
            middle[:2] += aside * np.array([np.cos(2.1 * k), np.sin(2.1 * k)]) * (len(names) > 1)
            world.place(name, pose((*middle[:2], middle[2] + 0.01 * k)))
            action = world.robot.action
            for _ in range(CONTROL_HZ // 2):
                world.robot.act(action)
                world.step()
        world.steps = 0
        if missing := set(names) - set(world.within(vessel)):
            raise BackendError(
                f"{', '.join(sorted(missing))} did not stay in {vessel}, which is to hold it at the start"
            )


def _posture(
    world: SimWorld,
    robot: RobotModel,
    T_world_base: Array,
    side: Side,
    name: str,
    arms: Mapping[Side, Array],
    loads: Mapping[Side, Load],
    around: Obstacles,
) -> tuple[Array, Array, Load]:
    """T_world_thing (4, 4), the arm's posture (7,) and what the hand will hold, in its tcp frame."""
    for x, y, z, yaw in _PLACES:
        T = matmul(T_world_base, pose((x, y * SIGN[side], z), yaw))
        world.place(name, T)
        heading = float(np.arctan2(T_world_base[1, 0], T_world_base[0, 0]))
        for grasp in sorted(grasps(TrueScene(world), robot.hand, name, heading), key=lambda g: g.cost):
            T_world_tcp = _shallow_enough(grasp.T_world_tcp, world.solids(name), robot)
            if T_world_tcp is None:
                continue
            frame = kin.inverse(T_world_tcp)
            load = Load([s.moved(frame) for s in world.solids(name)], [v.moved(frame) for v in world.volumes(name)])
            T_chest_tcp = matmul(kin.inverse(matmul(T_world_base, robot.chest(robot.travel_torso))), T_world_tcp)
            _, found = robot.arm_inverse(T_chest_tcp, side)
            if not len(found):
                continue
            body = Body(robot, robot.travel_torso, dict(arms), {**loads, side: load}, around)
            free = found[body.free(side, found, margin=0.01)]
            if len(free):
                best = posture_distance(free, robot.travel_arm[side]).argmin()
                return T, free[best], load
    raise BackendError(f"{name} does not fit into the {side} hand that is to hold it at the start")


def _shallow_enough(T_world_tcp: Array, solids: Sequence[Solid], robot: RobotModel) -> Array | None:
    """The hand drawn back until something is between its pads: grasps take for massive what has legs."""
    for back in (0.0, 0.01, 0.02, 0.03):
        p, closing = T_world_tcp[:3, 3] - back * T_world_tcp[:3, 2], T_world_tcp[:3, 1]
        if any((span := interval(s, p, closing)) and abs(sum(span)) / 2 < robot.hand.travel_m for s in solids):
            T = T_world_tcp.copy()
            T[:3, 3] = p
            return T
    return None
