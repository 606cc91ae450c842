"""A robot's articulation in SAPIEN, as far as it is only felt and looked at: its joints, links, hands and cameras."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import sapien

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CameraImage, Proprioception, Side
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.house.sim.cameras import Cameras
from mpvi_bt.house.sim.physics_of_robots import physics_of


class SimBody:
    """What a robot feels.

    Attributes:
        model: What robot it is.
        physics: What physics needs to know of it.
        articulation: Its joints and links.
        links: The links by name.
    """

    def __init__(
        self,
        articulation: sapien.physx.PhysxArticulation,
        model: RobotDescription,
        cameras: Cameras | None,
        prefix: str = "",
    ) -> None:
        """Take an articulation.

        Args:
            articulation: Its joints and links have the names of `model`.
            model: What robot it is.
            cameras: None: no pictures.
            prefix: What their names begin with.
        """
        self.articulation, self.model, self.physics = articulation, model, physics_of(model)
        self._cameras = cameras
        self.links = {link.name.removeprefix(prefix): link for link in articulation.links}
        self._joints = {joint.name.removeprefix(prefix): joint for joint in articulation.active_joints}
        order = list(self._joints)
        self._base = np.array([order.index(n) for n in self.physics.base_joints])
        self._torso = [(i, order.index(n)) for i, n in enumerate(model.torso_joints) if n is not None]
        self._arm = {s: np.array([order.index(n) for n in names], int) for s, names in model.arm_joints.items()}
        self._fingers = {
            s: np.array([order.index(f.joint) for f in group], int) for s, group in self.physics.fingers.items()
        }
        self._closed = {s: np.array([f.closed for f in group]) for s, group in self.physics.fingers.items()}
        self._rates = {s: np.array([f.rate for f in group]) for s, group in self.physics.fingers.items()}
        self._felt: Proprioception | None = None

    @property
    def gripper_command(self) -> Mapping[Side, float]:
        """Last command of each gripper, -1 closed ... 1 open."""
        raise NotImplementedError

    @property
    def arm_command(self) -> Mapping[Side, Array]:
        """(n,) what each arm was told last."""
        raise NotImplementedError

    def proprioception(self) -> Proprioception:
        """What is felt at this step; measured once a step."""
        if self._felt is None:
            q, v = self.articulation.get_qpos().astype(float), self.articulation.get_qvel().astype(float)
            x, y, yaw = q[self._base]
            c, s = np.cos(yaw), np.sin(yaw)
            vx, vy, w = v[self._base]
            torso, torso_velocity = np.zeros(len(self.model.torso_joints)), np.zeros(len(self.model.torso_joints))
            for i, joint in self._torso:
                torso[i], torso_velocity[i] = q[joint], v[joint]
            self._felt = Proprioception(
                base_pose=np.array([x, y, kin.wrap(yaw)]),
                base_velocity=np.array([c * vx + s * vy, -s * vx + c * vy, w]),
                torso=torso,
                arm={k: q[i] for k, i in self._arm.items()},
                arm_velocity={k: v[i] for k, i in self._arm.items()},
                gripper_width={k: self._apart(q[i] - self._closed[k], k) for k, i in self._fingers.items()},
                gripper_command=self.gripper_command,
                arm_command=self.arm_command,
                torso_velocity=torso_velocity,
                gripper_velocity={k: self._apart(v[i], k) for k, i in self._fingers.items()},
                robot=self.model.name,
                open_m=self.model.opening_m,
                grasp_m=self.model.grasp_m,
            )
        return self._felt

    def _apart(self, moved: Array, side: Side) -> float:
        """How far fingers are apart by how far the joints of a hand are from closed; or how fast, by their speeds."""
        return float((moved / self._rates[side]).sum()) * (2 / len(moved))

    def forget(self) -> None:
        """Have the next `proprioception` measure anew: physics has gone on outside of a control step."""
        self._felt = None

    def look(self, camera: str) -> CameraImage:
        """Render one of the robot's cameras. Raises NoRenderingDevice in a world that was built without rendering."""
        if self._cameras is None:
            raise Cameras.missing()
        image = self._cameras.look(camera)
        if self.model.cameras[camera].depth:
            return image
        return replace(image, depth=np.zeros_like(image.depth))

    def hand_pose_world(self, side: Side) -> Array:
        """T_world_tcp (4, 4) as the joints have it."""
        felt = self.proprioception()
        return matmul(kin.base(felt.base_pose), self.model.tcp(felt.torso, felt.arm[side], side))

    def hands_world(self) -> Array:
        """(n, 3) places in physics of the hand links, which carry the fingers [m]."""
        places = [self.links[self.physics.hand_links[side]].entity.pose.p for side in self.model.sides]
        return np.array(places, float).reshape(-1, 3)

    def fingertips_world(self) -> Array:
        """(2 n, 3) ends of the fingers of its hands, the left one's first [m]."""
        felt, out = self.proprioception(), []
        for side in self.model.sides:
            T = self.hand_pose_world(side)
            apart = felt.gripper_width[side] / 2 + self.physics.finger_half_m
            out += [T[:3, 3] + y * T[:3, 1] + self.physics.tip_m * T[:3, 2] for y in (-apart, apart)]
        return np.array(out).reshape(-1, 3)
