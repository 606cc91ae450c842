"""Demonstrations: what a robot felt, saw and was told at each step of an episode, and the file that keeps it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Policy
from mpvi_bt.ground.robot.protocol import Proprioception, Robot, Side
from mpvi_bt.hands.learned import mirroring
from mpvi_bt.hands.learned.learned_motions import LearnedMotion
from mpvi_bt.hands.learned.points import PointMemory

LOOK_STEPS = 10  # between looks: a chunk of the policy is about so long
HEAD_TILTS_RAD = (0.85, 1.15, 0.2)  # tried one after the other where the target is not in view
TILT_STEPS = 14  # that a tilt takes
SAMPLE = 128  # points
_SIZES: dict[str, tuple[int, ...]] = {
    "base": (3,), "velocity": (3,), "torso": (4,), "arm": (7,), "width": (), "look": (),
    "action": (mirroring.LAYOUT.size,),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Demonstration:
    """One episode of n steps, done with one hand, as if it were the right one: with the left it is mirrored.

    Attributes:
        base: (n, 3) believed base pose x, y [m], yaw [rad].
        velocity: (n, 3) of the base in its frame [m/s, rad/s].
        torso: (n, 4) joints, as in its layout.
        arm: (n, 7) joints [rad].
        width: (n,) between the fingers [m].
        action: (n, A) commanded.
        points: (m, 128, 3) samples of points in the world [m], of the target and of what is around it.
        look: (n,) the sample that was newest at each step; -1: it had not been seen.
    """

    base: Array
    velocity: Array
    torso: Array
    arm: Array
    width: Array
    action: Array
    points: Array
    look: Array

    def mirrored(self) -> Demonstration:
        """The same, done with the other hand."""
        return Demonstration(
            mirroring.base(self.base), mirroring.base(self.velocity), mirroring.torso(self.torso),
            mirroring.arm(self.arm), self.width, mirroring.action(self.action), mirroring.points(self.points),
            self.look,
        )  # fmt: skip

    def save(self, path: Path) -> None:
        """Write it, in single precision."""
        whole = {f.name: getattr(self, f.name) for f in fields(self)}
        np.savez(path, **{k: v.astype(np.int32 if k == "look" else np.float32) for k, v in whole.items()})

    @classmethod
    def load(cls, path: Path) -> Demonstration:
        """Read one that `save` wrote.

        Raises:
            UserError: It is none, is not whole, or has numbers that are not finite.
        """
        try:
            with np.load(path, allow_pickle=False) as kept:
                found = {f.name: np.asarray(kept[f.name]) for f in fields(cls)}
        except Exception as error:  # whatever zipfile, zlib and numpy make of broken bytes
            raise UserError(f"{path}: no whole demonstration ({' '.join(str(error).split())[:80]})") from None
        n, m = (len(found[name]) if found[name].ndim else 0 for name in ("look", "points"))
        for name, array in found.items():
            shape = (m, SAMPLE, 3) if name == "points" else (n, *_SIZES[name])
            kind = "iu" if name == "look" else "fiu"
            if array.shape != shape or array.dtype.kind not in kind or not np.isfinite(array).all():
                raise UserError(f"{path}: {name} is {array.dtype} {array.shape}, not {shape} finite numbers")
        if n and not -1 <= found["look"].min() <= found["look"].max() < m:
            raise UserError(f"{path}: look names samples that are not there; there are {m}")
        return cls(**found)


def record(
    policy: Policy, robot: Robot, step: Callable[[Array], None], over: Callable[[], bool], memory: PointMemory,
    prompt: str, side: Side, motion: LearnedMotion,
) -> Demonstration:  # fmt: skip
    """Let a policy that needs no pictures act, and record it.

    Args:
        policy: Who demonstrates.
        robot: Its senses are recorded.
        step: Carries out an action.
        over: Asked after every step.
        memory: Takes in what the head's and the hand's camera show.
        prompt: What the policy is told.
        side: The hand that it does it with.
        motion: What is demonstrated.
    """
    rows: dict[str, list[Array]] = {f.name: [] for f in fields(Demonstration)}
    policy.reset()
    sees = True
    while True:
        felt = robot.proprioception()
        if len(rows["look"]) % LOOK_STEPS == 0 and sees:
            memory.look(robot.look("head"), robot.look(side))
            if memory.seen:
                rows["points"].append(memory.sample())
        action = policy.infer({"prompt": prompt, "proprioception": felt, "images": {}})[0]
        sees = motion.sees(float(action[mirroring.LAYOUT.gripper[side]]))
        for name, value in _felt(felt, side).items():
            rows[name].append(value)
        rows["action"].append(action)
        rows["look"].append(np.array(len(rows["points"]) - 1))
        step(action)
        if over():
            shown = Demonstration(**{k: np.array(v) for k, v in rows.items()})
            return shown if side == mirroring.SIDE else shown.mirrored()


def find(robot: Robot, step: Callable[[Array], None], memory: PointMemory, side: Side) -> bool:
    """Look; where the target is not in view, tilt the head and look again. Returns whether it is seen."""
    memory.look(robot.look("head"), robot.look(side))
    for tilt in HEAD_TILTS_RAD:
        if memory.seen:
            return True
        action = robot.action
        action[mirroring.LAYOUT.torso.stop - 1] = tilt
        for _ in range(TILT_STEPS):
            step(action)
        memory.look(robot.look("head"), robot.look(side))
    return memory.seen


def _felt(felt: Proprioception, side: Side) -> dict[str, Array]:
    return {
        "base": felt.base_pose, "velocity": felt.base_velocity, "torso": felt.torso, "arm": felt.arm[side],
        "width": np.array(felt.gripper_width[side]),
    }  # fmt: skip
