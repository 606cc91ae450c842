"""BEHAVIOR's proprioception and action as numbers: one table of places, for both directions.

`encoded` makes an R1Pro's numbers of what a robot feels, as the evaluator sends them; `decoded` is its inverse. Names
of the entries are BEHAVIOR's (`PROPRIOCEPTION_INDICES` in its `eval_utils.py`).

Frames: base x forward, y left, z up; quaternions xyzw; angles [rad], positions [m].
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate

import numpy as np

from mpvi_bt.executive.remote.joint_dialects import DIALECTS, BaseVelocity, Dialect
from mpvi_bt.ground.errors import BadMessage
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.rotations import matrices, rotation
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import SIDES, Proprioception, Side
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.hands.behavior_robot.retargeting import as_r1pro

BASE_UNITS = np.array([0.75, 0.75, 1.0])  # [m/s, m/s, rad/s] of a base input of 1 (BEHAVIOR's r1pro.yaml)
BODY = "r1pro"  # the robot whose numbers these are
TYPE = "R1Pro"  # what BEHAVIOR calls it
ACTION_SIZE = 23  # numbers of its action
_BASE = slice(0, 3)  # of those
CAMERAS = ("left", "right", "head")  # order of `cam_rel_poses`
_USD = np.array([1.0, -1.0, -1.0])  # optical axes (z forward, y down) to USD's (looks along -z, y up)


def _hand_2025(side: Side) -> dict[str, int]:
    arm, hand = f"arm_{side}", f"gripper_{side}"
    joints = {f"{arm}_qpos": 7, f"{arm}_qpos_sin": 7, f"{arm}_qpos_cos": 7, f"{arm}_qvel": 7}
    return joints | {f"eef_{side}_pos": 3, f"eef_{side}_quat": 4, f"{hand}_qpos": 2, f"{hand}_qvel": 2}


def _hand_2026(side: Side) -> dict[str, int]:
    return {name: size for name, size in _hand_2025(side).items() if not name.endswith(("_sin", "_cos"))}


_SIZES: Mapping[Dialect, Mapping[str, int]] = {
    "behavior-2025": {
        "joint_qpos": 28, "joint_qpos_sin": 28, "joint_qpos_cos": 28, "joint_qvel": 28, "joint_qeffort": 28,
        "robot_pos": 3, "robot_ori_cos": 3, "robot_ori_sin": 3,
        "robot_2d_ori": 1, "robot_2d_ori_cos": 1, "robot_2d_ori_sin": 1, "robot_lin_vel": 3, "robot_ang_vel": 3,
        **_hand_2025("left"),
        **_hand_2025("right"),
        "trunk_qpos": 4, "trunk_qvel": 4, "base_qpos": 3, "base_qpos_sin": 3, "base_qpos_cos": 3, "base_qvel": 3,
    },
    "behavior-2026": {
        "base_qvel": 3,
        **_hand_2026("left"),
        **_hand_2026("right"),
        "trunk_qpos": 4, "trunk_qvel": 4,
    },
}  # fmt: skip


def _slices(sizes: Mapping[str, int]) -> dict[str, slice]:
    ends = list(accumulate(sizes.values()))
    return {name: slice(end - size, end) for (name, size), end in zip(sizes.items(), ends, strict=True)}


FIELDS: Mapping[Dialect, Mapping[str, slice]] = {dialect: _slices(sizes) for dialect, sizes in _SIZES.items()}
SIZE: Mapping[Dialect, int] = {dialect: sum(sizes.values()) for dialect, sizes in _SIZES.items()}  # 256 and 61
# Where each part is in `joint_qpos`: base x, y, z and about x, y, z, trunk, the arms' joints in turn, fingers.
_JOINTS: Mapping[str, slice] = {
    "base": slice(0, 6),
    "trunk": slice(6, 10),
    "arm_left": slice(10, 24, 2),
    "arm_right": slice(11, 24, 2),
    "gripper_left": slice(24, 26),
    "gripper_right": slice(26, 28),
}


def encoded(
    body: Proprioception,
    dialect: Dialect,
    base_velocity: BaseVelocity | None = None,
    loaded_at: Sequence[float] = (0.0, 0.0, 0.0),
) -> Array:
    """(256,) or (61,) the numbers of proprioception; another robot's as the nearest R1Pro's (`retargeting`).

    Efforts are not felt here and are 0.

    Args:
        body: What it feels.
        dialect: Whose layout.
        base_velocity: Frame of `base_qvel`, and of the base's part of `joint_qvel`: "world", the frame that the robot
            was loaded at (BEHAVIOR of 2025); "robot" (2026, the default there); or "zero", as in the demonstrations of
            2025, whose frames were restored one by one.
        loaded_at: x, y [m] and yaw [rad] of that frame in the world.

    Raises:
        UserError: The robot is too unlike an R1Pro.
    """
    frame = base_velocity or ("robot" if dialect == "behavior-2026" else "world")
    base = _base_velocity(body, frame, float(loaded_at[2]))
    fields = _felt(body) | {"base_qvel": base}
    if dialect == "behavior-2025":
        fields |= _world_fields(body, np.asarray(loaded_at, float))
        fields |= _joint_fields(fields, base)
    numbers = np.zeros(SIZE[dialect])
    for name, where in FIELDS[dialect].items():
        numbers[where] = fields.get(name, 0.0)
    return numbers


def _base_velocity(body: Proprioception, frame: BaseVelocity, loaded_yaw: float) -> Array:
    if frame == "zero":
        return np.zeros(3)
    return _turned(body.base_velocity, body.base_pose[2] - loaded_yaw) if frame == "world" else body.base_velocity


def _turned(velocity: Array, yaw: float) -> Array:
    """(3,) a planar velocity in a frame that `velocity`'s is turned by `yaw` in."""
    c, s = np.cos(yaw), np.sin(yaw)
    x, y, turn = velocity
    return np.array([c * x - s * y, s * x + c * y, turn])


def _felt(body: Proprioception) -> dict[str, Array]:
    """Entries of arms, hands and trunk: joints are an R1Pro's, hands are where the robot has them."""
    robot, like = robot_named(body.robot), as_r1pro(body)
    fields: dict[str, Array] = {"trunk_qpos": like.torso, "trunk_qvel": like.torso_velocity}
    for side in SIDES:
        q = like.arm[side]
        hand = robot.tcp(body.torso, body.arm[side], side)
        fields |= {
            f"arm_{side}_qpos": q,
            f"arm_{side}_qpos_sin": np.sin(q),
            f"arm_{side}_qpos_cos": np.cos(q),
            f"arm_{side}_qvel": like.arm_velocity[side],
            f"eef_{side}_pos": hand[:3, 3],
            f"eef_{side}_quat": rotation(hand[:3, :3]).as_quat(),
            f"gripper_{side}_qpos": np.full(2, body.gripper_width[side] / 2),
            f"gripper_{side}_qvel": np.full(2, body.gripper_velocity.get(side, 0.0) / 2),
        }
    return fields


def _world_fields(body: Proprioception, loaded_at: Array) -> dict[str, Array]:
    """Entries of 2025 for the base's pose in the world."""
    x, y, yaw = (float(number) for number in body.base_pose)
    turns, velocity = np.array([0.0, 0.0, yaw]), _turned(body.base_velocity, yaw)
    away = matmul(kin.inverse(kin.base(loaded_at)), kin.base(body.base_pose))
    since = np.array([away[0, 3], away[1, 3], float(kin.wrap(yaw - loaded_at[2]))])
    return {
        "robot_pos": np.array([x, y, 0.0]),
        "robot_ori_cos": np.cos(turns),
        "robot_ori_sin": np.sin(turns),
        "robot_2d_ori": turns[2:],
        "robot_2d_ori_cos": np.cos(turns[2:]),
        "robot_2d_ori_sin": np.sin(turns[2:]),
        "robot_lin_vel": np.array([*velocity[:2], 0.0]),
        "robot_ang_vel": np.array([0.0, 0.0, velocity[2]]),
        "base_qpos": since,
        "base_qpos_sin": np.sin(since),
        "base_qpos_cos": np.cos(since),
    }


def _joint_fields(fields: Mapping[str, Array], base_velocity: Array) -> dict[str, Array]:
    """The entries of all 28 joints, of those of the parts: sines and cosines are of one angle, felt or not."""
    qpos, qvel = np.zeros(28), np.zeros(28)
    x, y, yaw = fields["base_qpos"]
    qpos[_JOINTS["base"]] = (x, y, 0, 0, 0, yaw)
    qvel[_JOINTS["base"]] = (*base_velocity[:2], 0, 0, 0, base_velocity[2])
    for part in ("trunk", "arm_left", "arm_right", "gripper_left", "gripper_right"):
        qpos[_JOINTS[part]] = fields[f"{part}_qpos"]
        qvel[_JOINTS[part]] = fields[f"{part}_qvel"]
    return {"joint_qpos": qpos, "joint_qpos_sin": np.sin(qpos), "joint_qpos_cos": np.cos(qpos), "joint_qvel": qvel}


def fields_of(numbers: Array, dialect: Dialect) -> dict[str, Array]:
    """The entries of proprioception that the evaluator sent, by name.

    Args:
        numbers: (256,) or (61,), or with leading dimensions of 1 (a batch).
        dialect: Whose layout.

    Raises:
        BadMessage: Another number of them, which dialect would fit, or which entry is not finite.
    """
    shape, given = np.shape(numbers), np.asarray(numbers, float).reshape(-1)
    if given.size != SIZE[dialect] or shape[-1:] != given.shape:
        fits = next((f", as {other} has" for other in DIALECTS if SIZE[other] == shape[-1]), "") if shape else ""
        raise BadMessage(f"proprioception of shape {shape}{fits}; {dialect} has {SIZE[dialect]} numbers")
    fields = {name: given[where] for name, where in FIELDS[dialect].items()}
    if not np.isfinite(given).all():
        at = int(np.argmin(np.isfinite(given)))
        name, where = next((n, where) for n, where in FIELDS[dialect].items() if at < where.stop)
        raise BadMessage(f"proprioception: {given[at]} at {at}, which is {name}[{at - where.start}] of {dialect}")
    return fields


def decoded(
    fields: Mapping[str, Array],
    base_pose: Array,
    gripper_command: Mapping[Side, float],
    arm_command: Mapping[Side, Array] | None = None,
) -> Proprioception:
    """What an R1Pro feels, of the entries of `fields_of`.

    Args:
        fields: By name.
        base_pose: (3,) where it is: the numbers of 2026 do not say, for those of 2025 see `pose_in_world`.
        gripper_command, arm_command: What it was last told, which is not among the numbers.
    """
    return Proprioception(
        base_pose=np.asarray(base_pose, float),
        base_velocity=velocity_of_base(fields),
        torso=fields["trunk_qpos"],
        arm={side: fields[f"arm_{side}_qpos"] for side in SIDES},
        arm_velocity={side: fields[f"arm_{side}_qvel"] for side in SIDES},
        gripper_width={side: max(float(fields[f"gripper_{side}_qpos"].sum()), 0.0) for side in SIDES},
        gripper_command=dict(gripper_command),
        arm_command=dict(arm_command or {}),
        torso_velocity=fields["trunk_qvel"],
        gripper_velocity={side: float(fields[f"gripper_{side}_qvel"].sum()) for side in SIDES},
        robot=BODY,
    )


def velocity_of_base(fields: Mapping[str, Array]) -> Array:
    """(3,) in the robot's frame. The 2025 fields are turned from the frame in which the robot was loaded."""
    return _turned(fields["base_qvel"], -fields["base_qpos"][2]) if "base_qpos" in fields else fields["base_qvel"]


def pose_in_world(fields: Mapping[str, Array]) -> Array | None:
    """(3,) x, y, yaw; None in 2026. The standard track of 2025 bans it, though it is sent."""
    return np.array([*fields["robot_pos"][:2], fields["robot_2d_ori"][0]]) if "robot_pos" in fields else None


def action_from(theirs: Array) -> Array:
    """(..., 23) our action of BEHAVIOR's, for an R1Pro: the base's part is clipped to -1..1 and scaled."""
    ours = np.array(theirs, float)
    ours[..., _BASE] = np.clip(ours[..., _BASE], -1.0, 1.0) * BASE_UNITS
    return ours


def action_for(ours: Array) -> Array:
    """(..., 23) our action as BEHAVIOR's, for an R1Pro; base speeds are clipped to the limits."""
    theirs = np.array(ours, float)
    assert theirs.shape[-1] == ACTION_SIZE
    theirs[..., _BASE] = np.clip(theirs[..., _BASE] / BASE_UNITS, -1.0, 1.0)
    return theirs


def camera_poses(T_base_camera: Mapping[str, Array]) -> Array:
    """(21,) `cam_rel_poses`: position and quaternion xyzw of left wrist, right wrist and head, in USD's axes.

    Args:
        T_base_camera: (4, 4) of "left", "right" and "head", optical frames.
    """
    poses = [T_base_camera[camera] for camera in CAMERAS]
    return np.concatenate([[*T[:3, 3], *rotation(T[:3, :3] * _USD).as_quat()] for T in poses])


def cameras_in_base(numbers: Array) -> dict[str, Array]:
    """T_base_camera (4, 4), optical frame, of each camera, of `cam_rel_poses` (21,) or (1, 21).

    Raises:
        BadMessage: There are not 21, not all are finite, or a quaternion is 0.
    """
    given = np.asarray(numbers, float)
    if given.size != 21 or not np.isfinite(given).all():
        raise BadMessage(f"cam_rel_poses of shape {given.shape}; 21 finite numbers are wanted")
    places, quaternions = np.split(given.reshape(3, 7), [3], axis=1)
    lengths = norm(quaternions, axis=1)
    if not lengths.all():
        raise BadMessage(f"cam_rel_poses: the quaternion of {CAMERAS[int(lengths.argmin())]} is 0")
    turns = matrices(quaternions / lengths[:, None]) * _USD
    return {camera: kin.transform(R, place) for camera, R, place in zip(CAMERAS, turns, places, strict=True)}
