"""The r1 in SAPIEN: what it feels, and the drives that carry out its command."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import sapien

from mpvi_bt.errors import BackendError
from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot import r1
from mpvi_bt.robot.limits import within_limits
from mpvi_bt.robot.protocol import ACTION_SIZE, CONTROL_HZ, SIDES, ActionLayout, CameraImage, Proprioception, Side
from mpvi_bt.robot.solids import Array
from mpvi_bt.robot.urdf import urdf
from mpvi_bt.sim.cameras import Cameras

FINGER_FRICTION = 2.0  # rubber pads
_HALF_FINGER_M, _FINGERTIP_M = 0.0065, 0.012  # a finger's half thickness; its end lies that far before the tcp
_CLOSED_M = -0.01  # finger target beyond zero: grip force = stiffness * (half width + 1 cm)
_BASE_ACCELERATION = np.array([1.5, 1.5, 3.0])  # [m/s^2, m/s^2, rad/s^2]: a jerk flings what is held
_DRIVEN = np.r_[3:14, 15:22]  # of an action: torso, left arm, right arm


class SimRobot:
    """`mpvi_bt.robot.protocol.Robot` over a SAPIEN articulation.

    Attributes:
        links: The articulation's links by name.
    """

    def __init__(self, scene: sapien.Scene, base_pose: Array, cameras: Cameras | None) -> None:
        """Put the robot into `scene` at `base_pose` (3,) x, y [m], yaw [rad], hands folded; no cameras: no pictures."""
        self._articulation = _load(scene, visible=cameras is not None)
        self._cameras = cameras
        self.links = {link.name: link for link in self._articulation.links}
        order = [joint.name for joint in self._articulation.active_joints]
        self._joints = {joint.name: joint for joint in self._articulation.active_joints}
        self._base = [order.index(n) for n in r1.BASE_JOINTS]
        self._torso = [order.index(n) for n in r1.TORSO_JOINTS]
        self._arm = {s: [order.index(n) for n in r1.ARM_JOINTS[s]] for s in SIDES}
        self._fingers = {s: [order.index(n) for n in r1.FINGER_JOINTS[s]] for s in SIDES}
        self._targets = [self._joints[n] for n in (*r1.TORSO_JOINTS, *r1.ARM_JOINTS["left"], *r1.ARM_JOINTS["right"])]
        for name, joint in self._joints.items():
            gains = r1.drive(name)
            joint.set_drive_properties(gains.stiffness, gains.damping, gains.force, mode="force")
            joint.set_friction(0.0)
        for link in self._articulation.links:
            link.disable_gravity = True  # the arms are taken to be gravity-compensated
        self._exempt_neighbors()
        if cameras is not None:
            for name, camera in r1.CAMERAS.items():
                cameras.mount(name, camera, self.links[camera.link].entity)

        action = np.zeros(ACTION_SIZE)
        action[ActionLayout.TORSO] = r1.TRAVEL_TORSO
        for s in SIDES:
            action[ActionLayout.ARM[s]] = r1.TRAVEL_ARM[s]
            action[ActionLayout.GRIPPER[s]] = 1.0
        self._action = action
        self._sent: Array | None = None
        self._moving = True
        self._velocity = np.zeros(3)
        self._felt: Proprioception | None = None
        q = np.zeros(len(order))
        q[self._base], q[self._torso] = base_pose, r1.TRAVEL_TORSO
        for s in SIDES:
            q[self._arm[s]], q[self._fingers[s]] = r1.TRAVEL_ARM[s], r1.FINGER_TRAVEL_M
        self._articulation.set_qpos(q)
        self._articulation.set_qvel(np.zeros_like(q))
        self.apply()

    @property
    def articulation(self) -> sapien.physx.PhysxArticulation:
        """The joints and links."""
        return self._articulation

    @property
    def action(self) -> Array:
        """(23,) a copy of the command of the next step, `ActionLayout`."""
        return self._action.copy()

    def act(self, action: Array) -> None:
        """Set the command of the next step, brought within the robot's limits.

        Raises:
            BackendError: The action is not 23 finite numbers.
        """
        action = np.asarray(action, float)
        if action.shape != (ACTION_SIZE,):
            raise BackendError(f"an action of shape {action.shape} was given; it has to be ({ACTION_SIZE},)")
        if not np.isfinite(action).all():
            raise BackendError(f"an action that is not finite was given: {action.tolist()}")
        self._action = within_limits(action)

    def hold(self) -> None:
        """Stand still; every joint keeps its target."""
        self._action[ActionLayout.BASE] = 0.0

    def proprioception(self) -> Proprioception:
        """What is felt at this step; measured once a step."""
        if self._felt is None:
            q, v = self._articulation.get_qpos().astype(float), self._articulation.get_qvel().astype(float)
            x, y, yaw = q[self._base]
            c, s = np.cos(yaw), np.sin(yaw)
            vx, vy, w = v[self._base]
            self._felt = Proprioception(
                base_pose=np.array([x, y, kin.wrap(yaw)]),
                base_velocity=np.array([c * vx + s * vy, -s * vx + c * vy, w]),
                torso=q[self._torso],
                arm={k: q[i] for k, i in self._arm.items()},
                arm_velocity={k: v[i] for k, i in self._arm.items()},
                gripper_width={k: float(q[i].sum()) for k, i in self._fingers.items()},
                gripper_command={k: float(self._action[i]) for k, i in ActionLayout.GRIPPER.items()},
                arm_command={k: self._action[i].copy() for k, i in ActionLayout.ARM.items()},
            )
        return self._felt

    def forget(self) -> None:
        """Have the next `proprioception` measure anew: physics has gone on outside of a control step."""
        self._felt = None

    def look(self, camera: str) -> CameraImage:
        """Render one of the robot's cameras. Raises NoRenderingDevice in a world that was built without rendering."""
        if self._cameras is None:
            raise Cameras.missing()
        return self._cameras.look(camera)

    def hand_pose_world(self, side: Side) -> Array:
        """T_world_tcp (4, 4) as the joints have it."""
        felt = self.proprioception()
        return kin.base(felt.base_pose) @ kin.tcp(felt.torso, felt.arm[side], side)

    def fingertips_world(self) -> Array:
        """(4, 3) ends of the fingers: left hand, right hand [m]."""
        felt, out = self.proprioception(), []
        base, chest = kin.base(felt.base_pose), kin.chest(felt.torso)
        for side in SIDES:
            T = base @ (chest @ kin.arm(felt.arm[side], side))
            apart = felt.gripper_width[side] / 2 + _HALF_FINGER_M
            out += [T[:3, 3] + y * T[:3, 1] + _FINGERTIP_M * T[:3, 2] for y in (-apart, apart)]
        return np.array(out)

    def save(self) -> dict[str, list[float]]:
        """How it stands and moves, and its command."""
        return {
            "q": self._articulation.get_qpos().tolist(),
            "v": self._articulation.get_qvel().tolist(),
            "action": self._action.tolist(),
            "base": self._velocity.tolist(),
        }

    def restore(self, saved: Mapping[str, list[float]]) -> None:
        """Have it stand and move so. Raises KeyError or ValueError if that is of another robot."""
        joints = len(self._articulation.get_qpos())
        sizes = {"q": joints, "v": joints, "action": ACTION_SIZE, "base": 3}
        values = {key: np.array(saved[key], float) for key in sizes}
        for key, size in sizes.items():
            if values[key].shape != (size,) or not np.isfinite(values[key]).all():
                raise ValueError(f"robot {key!r}: {size} finite numbers are due")
        self._articulation.set_qpos(values["q"])
        self._articulation.set_qvel(values["v"])
        self._velocity = values["base"]
        for name in r1.BASE_JOINTS:  # what it was doing until now; `apply` goes on from the saved speed
            self._joints[name].set_drive_velocity_target(0.0)
        self._sent = None
        self.act(values["action"])
        self.apply()

    def standing_at(self, base_pose: Array, q: list[float]) -> list[float]:
        """Joints `q`, as `save` has them, with the base at x, y [m], yaw [rad] (3,)."""
        joints = np.array(q)
        joints[self._base] = base_pose
        out: list[float] = joints.tolist()
        return out

    def stand(self, arms: Mapping[Side, Array]) -> None:
        """Have arms stand in postures (7,) at once, at rest, and keep them."""
        q, action = self._articulation.get_qpos(), self.action
        for side, posture in arms.items():
            q[self._arm[side]] = action[ActionLayout.ARM[side]] = posture
        self._articulation.set_qpos(q)
        self._articulation.set_qvel(np.zeros_like(q))
        self._sent = None
        self.act(action)
        self.apply()

    def apply(self) -> None:
        """Send the command to the drives. The world calls it once a control step."""
        action, sent = self._action, self._sent
        self._drive_base(action[ActionLayout.BASE])
        if sent is None or not np.array_equal(action[3:], sent[3:]):
            before = action if sent is None else sent
            for joint, target, last in zip(
                self._targets, action[_DRIVEN].tolist(), before[_DRIVEN].tolist(), strict=True
            ):
                joint.set_drive_target(target)
                # Without its velocity a PD drive trails a moving target by damping / stiffness = 0.1 s.
                joint.set_drive_velocity_target((target - last) * CONTROL_HZ)
            for s in SIDES:
                finger = _CLOSED_M + (float(action[ActionLayout.GRIPPER[s]]) + 1) / 2 * (r1.FINGER_TRAVEL_M - _CLOSED_M)
                for name in r1.FINGER_JOINTS[s]:
                    self._joints[name].set_drive_target(finger)
            self._sent, self._moving = action.copy(), True
        elif self._moving:
            for joint in self._targets:
                joint.set_drive_velocity_target(0.0)
            self._moving = False
        self.forget()

    def _drive_base(self, wanted: Array) -> None:
        limit = _BASE_ACCELERATION / CONTROL_HZ
        change = np.clip(wanted - self._velocity, -limit, limit)
        if not change.any() and not self._velocity.any():
            return
        self._velocity = self._velocity + change
        yaw = (
            self.proprioception().base_pose[2] + self._velocity[2] / CONTROL_HZ / 2
        )  # the heading midway through the step
        c, s = np.cos(yaw), np.sin(yaw)
        vx, vy, w = self._velocity
        for name, v in zip(r1.BASE_JOINTS, (c * vx - s * vy, s * vx + c * vy, w), strict=True):
            self._joints[name].set_drive_velocity_target(float(v))

    def _exempt_neighbors(self) -> None:
        """Let neighbors that overlap at their joint pass through each other; physics exempts only parent and child."""
        groups = [["base_link", "torso_lift_link", "waist_link", "chest_link", "head_link"]]
        for s in SIDES:
            hand = f"{s}_hand"
            groups += [
                [f"{s}_arm_link3", f"{s}_arm_link5"],
                [f"{s}_arm_link5", hand],
                [n.removesuffix("_joint") for n in r1.FINGER_JOINTS[s]],
            ]
        for bit, group in enumerate(groups, start=20):
            for name in group:
                for shape in self.links[name].collision_shapes:
                    words = list(shape.get_collision_groups())
                    words[2] |= 1 << bit
                    shape.set_collision_groups(words)


def _load(scene: sapien.Scene, visible: bool) -> sapien.physx.PhysxArticulation:
    loader = scene.create_urdf_loader()
    loader.fix_root_link = True
    for s in SIDES:
        for finger in r1.FINGER_JOINTS[s]:
            name = finger.removesuffix("_joint")
            loader.set_link_material(name, FINGER_FRICTION, FINGER_FRICTION, 0.0)
            loader.set_link_patch_radius(name, 0.1)
            loader.set_link_min_patch_radius(name, 0.1)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "r1.urdf"
        path.write_text(urdf() if visible else _without_visuals(urdf()))
        return loader.load(str(path))


def _without_visuals(text: str) -> str:
    """The same URDF with nothing to draw: SAPIEN asks for a rendering device as soon as it reads a visual."""
    robot = ElementTree.fromstring(text)
    for link in robot.iter("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
    return ElementTree.tostring(robot, encoding="unicode")
