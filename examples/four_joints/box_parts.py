"""The robot's policy, which picks up what it sees, and a checker that sees whether it has."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from mpvi_bt.ground.geometry.kinematics import base
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Judgement
from mpvi_bt.ground.robot.protocol import CameraImage


def seen(image: CameraImage) -> Array:
    """(n, 3) points of the box in the world."""
    assert image.labels is not None  # the example's own pictures have labels
    return image.points_world()[np.isin(image.labels, [i for i, name in image.names.items() if name == "box"])]


class Pick:
    """Reaches for the middle of the box, closes the gripper and lifts: pan, lift and reach are where it is."""

    name, cameras = "pick", ("head",)

    def reset(self) -> None:
        """There is nothing to forget."""

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """(180, 6): two seconds to get there, two to close, two to lift."""
        pose = observation["proprioception"].base_pose
        x, y, z = (np.linalg.inv(base(pose)) @ [*np.median(seen(observation["images"]["head"]), axis=0), 1.0])[:3]
        rows = np.zeros((180, 6))
        rows[:, 2:5] = np.arctan2(y, x), z - 0.1, np.hypot(x, y) - 0.25
        rows[120:, 3] += 0.3
        rows[:, 5] = np.where(np.arange(180) < 60, 1.0, -1.0)
        return rows


class Lifted:
    """Says yes where the box is seen higher than it stands on the floor."""

    name, needs_image = "lifted", True

    def check(self, criterion: str, image: CameraImage | None) -> Judgement:
        """By the highest point of it in the picture: on the floor that is at 0.4 m."""
        assert image is not None
        highest = float(np.max(seen(image)[:, 2], initial=0.0))
        return Judgement(highest > 0.5, f"the box is seen up to {highest:.2f} m")
