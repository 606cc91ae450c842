"""A robot in SAPIEN: the drives that carry out its command."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import sapien

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.limits import BASE_ACCELERATION, commanded, travel_action
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Side
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.house.sim.body import SimBody
from mpvi_bt.house.sim.cameras import Cameras
from mpvi_bt.house.sim.physics_of_robots import physics_of
from mpvi_bt.house.sim.robot_physics import RobotPhysics

FINGER_FRICTION = 2.0  # rubber pads
CLOSED_M = -0.01  # finger target beyond zero: grip force = stiffness * (half width + 1 cm)


class SimRobot(SimBody):
    """`mpvi_bt.ground.robot.protocol.Robot` over a SAPIEN articulation."""

    def __init__(
        self, scene: sapien.Scene, base_pose: Array, cameras: Cameras | None, model: RobotDescription = R1
    ) -> None:
        """Put a robot into `scene` at `base_pose` (3,) x, y [m], yaw [rad], hands folded; no cameras: no pictures."""
        super().__init__(load_robot(scene, model, visible=cameras is not None), model, cameras)
        layout = model.layout
        torso = [(n, i) for i, n in enumerate(model.torso_joints, layout.torso.start) if n is not None]
        arms = [(n, layout.arm[s].start + i) for s in model.sides for i, n in enumerate(model.arm_joints[s])]
        self._targets = [self._joints[n] for n, _ in (*torso, *arms)]
        self._driven = np.array([i for _, i in (*torso, *arms)], int)  # where these are in an action
        self._kept = [i for i in range(layout.size) if i not in layout.base]
        if cameras is not None:
            for name, camera in model.cameras.items():
                cameras.mount(name, camera, self.links[camera.link].entity, self.physics.mounts.get(name))

        self._action = travel_action(model)
        self._sent: Array | None = None
        self._moving = True
        self._velocity = np.zeros(3)
        q = np.zeros(len(self._joints))
        q[self._base] = base_pose
        for i, at in self._torso:
            q[at] = model.travel_torso[i]
        for s in model.sides:
            q[self._arm[s]] = model.travel_arm[s]
            q[self._fingers[s]] = [f.closed + f.rate * (model.opening_m / 2) for f in self.physics.fingers[s]]
        self.articulation.set_qpos(q)
        self.articulation.set_qvel(np.zeros_like(q))
        self.apply()

    @property
    def action(self) -> Array:
        """(A,) a copy of the command of the next step, by the robot's layout."""
        return self._action.copy()

    def act(self, action: Array) -> None:
        """Set the command of the next step, brought within the robot's limits.

        Raises:
            BackendError: The action is not as many finite numbers as its layout has.
        """
        self._action = commanded(self.model, action)

    @property
    def gripper_command(self) -> Mapping[Side, float]:
        """Last command of each gripper, -1 closed ... 1 open."""
        return {s: float(self._action[self.model.layout.gripper[s]]) for s in self.model.sides}

    @property
    def arm_command(self) -> Mapping[Side, Array]:
        """(n,) what each arm was told last."""
        return {s: self._action[self.model.layout.arm[s]].copy() for s in self.model.sides}

    def hold(self) -> None:
        """Stand still; every joint keeps its target."""
        self.model.layout.set_velocity(self._action, 0.0)

    def save(self) -> dict[str, list[float]]:
        """How it stands and moves, and its command."""
        return {
            "q": self.articulation.get_qpos().tolist(),
            "v": self.articulation.get_qvel().tolist(),
            "action": self._action.tolist(),
            "base": self._velocity.tolist(),
        }

    def restore(self, saved: Mapping[str, list[float]]) -> None:
        """Have it stand and move so. Raises KeyError or ValueError if that is of another robot."""
        joints = len(self.articulation.get_qpos())
        sizes = {"q": joints, "v": joints, "action": self.model.layout.size, "base": 3}
        values = {key: np.array(saved[key], float) for key in sizes}
        for key, size in sizes.items():
            if values[key].shape != (size,) or not np.isfinite(values[key]).all():
                raise ValueError(f"robot {key!r}: {size} finite numbers are due")
        self.articulation.set_qpos(values["q"])
        self.articulation.set_qvel(values["v"])
        self._velocity = values["base"]
        for name in self.physics.base_joints:  # what it was doing until now; `apply` goes on from the saved speed
            self._joints[name].set_drive_velocity_target(0.0)
        self._sent = None
        self.act(values["action"])
        self.apply()

    def stand(self, arms: Mapping[Side, Array]) -> None:
        """Have arms stand in postures (n,) at once, at rest, and keep them."""
        q, action = self.articulation.get_qpos(), self.action
        for side, posture in arms.items():
            q[self._arm[side]] = action[self.model.layout.arm[side]] = posture
        self.articulation.set_qpos(q)
        self.articulation.set_qvel(np.zeros_like(q))
        self._sent = None
        self.act(action)
        self.apply()

    def apply(self) -> None:
        """Send the command to the drives. The world calls it once a control step."""
        action, sent = self._action, self._sent
        self._drive_base(self.model.layout.velocity(action))
        if sent is None or not np.array_equal(action[self._kept], sent[self._kept]):
            before = action if sent is None else sent
            for joint, target, last in zip(
                self._targets, action[self._driven].tolist(), before[self._driven].tolist(), strict=True
            ):
                joint.set_drive_target(target)
                # Without its velocity a PD drive trails a moving target by damping / stiffness = 0.1 s.
                joint.set_drive_velocity_target((target - last) * CONTROL_HZ)
            for s in self.model.sides:
                open_m = self.model.opening_m / 2 - CLOSED_M
                out_m = CLOSED_M + (float(action[self.model.layout.gripper[s]]) + 1) / 2 * open_m
                for finger in self.physics.fingers[s]:
                    self._joints[finger.joint].set_drive_target(finger.closed + finger.rate * out_m)
            for follower in self.physics.followers:
                target = float(self._joints[follower.followed].drive_target[0])
                self._joints[follower.joint].set_drive_target(follower.factor * target + follower.offset)
            self._sent, self._moving = action.copy(), True
        elif self._moving:
            for joint in self._targets:
                joint.set_drive_velocity_target(0.0)
            self._moving = False
        self.forget()

    def _drive_base(self, wanted: Array) -> None:
        limit = BASE_ACCELERATION / CONTROL_HZ
        change = np.clip(wanted - self._velocity, -limit, limit)
        if not change.any() and not self._velocity.any():
            return
        self._velocity = self._velocity + change
        yaw = (
            self.proprioception().base_pose[2] + self._velocity[2] / CONTROL_HZ / 2
        )  # the heading midway through the step
        c, s = np.cos(yaw), np.sin(yaw)
        vx, vy, w = self._velocity
        for name, v in zip(self.physics.base_joints, (c * vx - s * vy, s * vx + c * vy, w), strict=True):
            self._joints[name].set_drive_velocity_target(float(v))


def load_robot(scene: sapien.Scene, model: RobotDescription, visible: bool) -> sapien.physx.PhysxArticulation:
    """A robot's joints and links with its drives' gains, all joints at 0; `visible`: with what cameras see of it.

    Raises:
        UserError: The simulator cannot build its URDF.
    """
    physics = physics_of(model)
    try:
        articulation = _load(scene, physics, visible)
    except (AssertionError, ValueError, KeyError, RuntimeError) as error:  # what its URDF loader raises of bad files
        raise UserError(f"{model.name}: the simulator cannot build its URDF: {error}") from error
    joints = {joint.name: joint for joint in articulation.active_joints}
    for name, joint in joints.items():
        gains = physics.drives[name]
        gripping = any(name == finger.joint for group in physics.fingers.values() for finger in group)
        mode = "force" if gripping else physics.mode
        joint.set_drive_properties(gains.stiffness, gains.damping, gains.force, mode=mode)
        joint.set_friction(0.0)
    for name in physics.still:
        joints[name].set_drive_target(0.0)
    for link in articulation.links:
        link.disable_gravity = True  # the arms are taken to be gravity-compensated
    _exempt_neighbors(physics, {link.name: link for link in articulation.links})
    return articulation


def _exempt_neighbors(physics: RobotPhysics, links: Mapping[str, sapien.physx.PhysxArticulationLinkComponent]) -> None:
    """Let neighbors that overlap at their joint pass through each other."""
    for bit, group in enumerate(physics.neighbors, start=20):
        for name in group:
            for shape in links[name].collision_shapes:
                words = list(shape.get_collision_groups())
                words[2] |= 1 << bit
                shape.set_collision_groups(words)


def _load(scene: sapien.Scene, physics: RobotPhysics, visible: bool) -> sapien.physx.PhysxArticulation:
    loader = scene.create_urdf_loader()
    loader.fix_root_link = True
    for fingers in physics.finger_links.values():
        for name in fingers:
            loader.set_link_material(name, FINGER_FRICTION, FINGER_FRICTION, 0.0)
            loader.set_link_patch_radius(name, 0.1)
            loader.set_link_min_patch_radius(name, 0.1)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.urdf"
        path.write_text(physics.urdf if visible else _without_visuals(physics.urdf))
        return loader.load(str(path))


def _without_visuals(text: str) -> str:
    """The same URDF with nothing to draw: SAPIEN asks for a rendering device as soon as it reads a visual."""
    robot = ElementTree.fromstring(text)
    for link in robot.iter("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
    return ElementTree.tostring(robot, encoding="unicode")
