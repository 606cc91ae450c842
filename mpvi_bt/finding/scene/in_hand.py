"""What a hand was found to hold: its shape from pictures that show it in the hand, from one side after the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mpvi_bt.finding.scene.frames import SEEN_PX, Frame
from mpvi_bt.finding.shapes.fit import fit
from mpvi_bt.finding.shapes.outlines import main_cluster
from mpvi_bt.finding.shapes.shape import Shape
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm, principal_axes
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.collision import Surroundings


@dataclass(frozen=True)
class InHandParameters:
    """Which part of a picture is the payload of a hand.

    Our choice, by things of the size that one hand holds.
    """

    reach_m: float = 0.35  # points of a mask farther than this from the hand are of another thing [m]
    kept: int = 8  # remembered pictures of a payload; what hangs in a hand swings a little
    alike: float = 0.9  # part of its points that lie where its shape has them [ratio]; with fewer it has slipped
    alike_m: float = 0.008  # largest distance of such a point from its surface [m]
    long: float = 2.0  # least length by width for a slanted payload [ratio]
    slanted_rad: tuple[float, float] = (0.06, 1.0)  # slants from upright [rad]; a payload across the hand is level


_HOLDING = InHandParameters()


class InHand:
    """Points of one held thing, gathered in the frame of the hand: they stay where they are as the hand moves."""

    def __init__(self, width_m: float) -> None:
        """Nothing seen yet but, by how far the fingers stand apart, that it reaches from the one to the other."""
        at = np.stack(np.meshgrid([-0.008, 0.0, 0.008], [-width_m / 2, 0.0, width_m / 2], [0.0]), -1)
        self._points: list[Array] = [at.reshape(-1, 3)]
        self._eyes: list[Array] = []  # of the head, in the hand's frame

    def add(self, frame: Frame, mask: NDArray[np.bool_], T_world_tcp: Array) -> None:
        """Take in one picture of it, with the hand as it was when the picture was taken."""
        self.take_in(frame.of(mask), frame.eye if frame.image.camera == "head" else None, T_world_tcp)

    def take_in(self, points: Array, eye: Array | None, T_world_tcp: Array) -> None:
        """Take in points (n, 3) of it in the world; `eye` (3,) is where the head's camera was, if it saw them."""
        T = kin.inverse(T_world_tcp)
        points = matmul(points, T[:3, :3].T) + T[:3, 3]
        points = points[norm(points, axis=1) < _HOLDING.reach_m]  # fingers part what they hold in two
        if len(points) < SEEN_PX:
            return
        self._points = [self._points[0], *self._points[1:][1 - _HOLDING.kept :], points]
        if eye is not None:
            self._eyes = [*self._eyes[1 - _HOLDING.kept :], matmul(T[:3, :3], eye) + T[:3, 3]]

    def shape(self, T_world_tcp: Array) -> Shape | None:
        """What it is, for the hand where it is now; None if too little was seen.

        It is taken to be held upright, unless it is long and seen to hang on a slant: a bottle turns about the fingers.
        """
        if len(self._points) < 2:
            return None
        points = matmul(np.concatenate(self._points), T_world_tcp[:3, :3].T) + T_world_tcp[:3, 3]
        eyes = matmul(np.reshape(self._eyes, (-1, 3)), T_world_tcp[:3, :3].T) + T_world_tcp[:3, 3]
        R = _slant(points)
        points, eyes = matmul(points, R), matmul(eyes, R)
        # what was once seen from above stays seen
        shape = fit(points, np.zeros((0, 3)), eyes[eyes[:, 2].argmax()] if len(eyes) else np.zeros(3))
        return None if shape is None else shape.moved(kin.transform(R, (0.0, 0.0, 0.0)))


def _slant(points: Array) -> Array:
    """The rotation (3, 3) that tilts what is upright to how long points (n, 3) hang; none where they are not long."""
    spread, axes = principal_axes(main_cluster(points))
    along = axes[0] * np.sign(axes[0, 2])
    turn = np.cross([0.0, 0.0, 1.0], along)
    angle = float(np.arctan2(norm(turn), along[2]))
    if spread[0] < _HOLDING.long * spread[1] or not _HOLDING.slanted_rad[0] < angle < _HOLDING.slanted_rad[1]:
        return np.eye(3)
    return np.asarray(Rotation.from_rotvec(turn / norm(turn) * angle).as_matrix())


def is_of(points: Array, shape: Shape) -> bool:
    """Whether points (n, 3) of what is seen in a hand are those of a shape: it has not slipped or turned there."""
    if len(points) < SEEN_PX:
        return False
    gaps = np.abs(Surroundings(shape.solids).distance(main_cluster(points)))
    return bool(np.quantile(gaps, _HOLDING.alike) < _HOLDING.alike_m)
