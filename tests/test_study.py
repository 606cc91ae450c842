"""Looking at what is to be worked on."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace

import numpy as np
import pytest

from mpvi_bt.manipulation.truth import TrueScene
from mpvi_bt.manipulation.work import Work
from mpvi_bt.robot import r1
from mpvi_bt.robot.motion import Motion
from mpvi_bt.robot.protocol import ActionLayout, CameraImage, Proprioception
from tests.small_house import placed, small_world


class Blind:
    """A `mpvi_bt.manipulation.scene.Sight` that learns nothing."""

    def see(self, images: Mapping[str, CameraImage], felt: Proprioception) -> None:
        """As `Sight` says."""

    def trusting(self) -> AbstractContextManager[None]:
        """As `Sight` says."""
        return nullcontext()


@pytest.mark.parametrize("board_m", [0.4, 0.9, 1.35, 1.6])
def test_no_look_asks_more_of_the_torso_than_it_can(board_m: float) -> None:
    """However high a compartment is, the torso stays within its limits while it is looked into, and what it is told."""
    cabinet = (
        f"{{entry: wall_cabinet, at: [1.2, 0.0], yaw_deg: 180, z_m: {board_m}, shape: {{size_m: [0.36, 0.6, 0.7]}}}}"
    )
    world = small_world({"can": placed("can_of_soda", 1.2, 0.0, board_m + 0.02)}, wall_cabinet_1=cabinet)
    work = Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0), Blind())
    work.images = {"head": None}  # type: ignore[dict-item]
    told = []
    for action in work.study("can"):
        told.append(action[ActionLayout.TORSO])
        work.motion.felt = replace(work.motion.felt, torso=told[-1])
    low, high = r1.TORSO_LIMITS.T
    assert len(told) > 1
    assert (np.stack(told) >= low - 1e-9).all()
    assert (np.stack(told) <= high + 1e-9).all()
