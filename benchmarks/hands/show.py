"""Pictures and films of a trial, to look at."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.house.sim.views import look_at
from mpvi_bt.house.sim.world import SimWorld

_SIZE = (640, 480)
_EVERY_STEPS = 6  # of a film: five pictures a second, played three times as fast


class Film:
    """Pictures of a world before and after a trial, and what happened in between if it is to be filmed."""

    def __init__(self, world: SimWorld, stem: Path, video: bool) -> None:
        """Take the first pictures, into `<stem>_start.png`; the film, if there is to be one, goes to `<stem>.mp4`."""
        stem.parent.mkdir(parents=True, exist_ok=True)
        self._world, self._stem = world, stem
        self._writer = None
        if video:
            codec = cv2.VideoWriter.fourcc(*"mp4v")
            self._writer = cv2.VideoWriter(f"{stem}.mp4", codec, 3 * CONTROL_HZ / _EVERY_STEPS, _SIZE)
        self._save("start")

    def step(self) -> None:
        """A step was taken."""
        if self._writer is not None and self._world.steps % _EVERY_STEPS == 0:
            self._writer.write(self._outside())

    def end(self) -> None:
        """Take the last pictures, into `<stem>_end.png`."""
        self._save("end")
        if self._writer is not None:
            self._writer.release()

    def _outside(self) -> np.ndarray:
        x, y, yaw = self._world.robot.proprioception().base_pose
        ahead, left = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
        here = np.array([x, y])
        eye = np.clip(here - 0.5 * ahead + 1.3 * left, -2.85, 2.85)
        T = look_at((*eye, 1.9), (*(here + 0.6 * ahead), 0.7))
        return self._world.look_from(T, _SIZE, 1.0).rgb[..., ::-1].copy()

    def _save(self, when: str) -> None:
        views = [self._world.robot.look(camera).rgb[..., ::-1] for camera in ("head", "left", "right")]
        wide = [cv2.resize(view, (_SIZE[1] // 3 * view.shape[1] // view.shape[0], _SIZE[1] // 3)) for view in views]
        column = np.zeros((_SIZE[1], max(view.shape[1] for view in wide), 3), np.uint8)
        for k, view in enumerate(wide):
            column[k * _SIZE[1] // 3 : (k + 1) * _SIZE[1] // 3, : view.shape[1]] = view
        cv2.imwrite(f"{self._stem}_{when}.png", np.hstack([self._outside(), column]))
