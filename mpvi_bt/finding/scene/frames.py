"""Pictures as a policy remembers them: points in the world by its own odometry, and what the pictures show."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mpvi_bt.finding.perception.detector import ROBOT, Detector, switch_of
from mpvi_bt.finding.perception.localize import pixels
from mpvi_bt.finding.scene.own_body import own_body
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.depth_noise import DEPTH_NOISE
from mpvi_bt.ground.robot.protocol import CameraImage, Proprioception
from mpvi_bt.ground.robot.robots import robot_named

# Our choice: the edges of masks and of steps in depth are off by a pixel or two.
_OWN_PX = 2  # the robot's mask is grown so far
_STEEP = 4.0  # faces seen at a flatter slant than one in so many are rare; their next row is that much farther
FLOOR_M = 0.025  # our choice: what is lower than this is taken for the floor, as camera mounts are off
SEEN_PX = 6  # our choice: a mask of fewer pixels tells no shape, and is not looked at


@dataclass(frozen=True)
class Keeping:
    """Which pictures are kept and for how long they count. Our choice: odometry drifts only while the base drives."""

    kept: int = 20  # remembered pictures
    moved: tuple[float, float] = (0.01, 0.015)  # a base that has moved farther stands at another place [m, rad]
    passed_m: float = 1.0  # driving after which a picture no longer shows where the base can go [m]
    carved: int = 4  # pictures of the head that the field of obstacles is carved from


_KEEPING = Keeping()


@dataclass(frozen=True, eq=False)
class Shown:
    """The pixels that a detector found for a phrase.

    Attributes:
        phrase: As asked for.
        mask: (H, W) bool.
    """

    phrase: str
    mask: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Frame:
    """One picture.

    Attributes:
        image: With `T_world_camera` as the joints have it.
        points: (H, W, 3) world position of every pixel [m]; nan where nothing was measured.
        robot: (H, W) bool, the robot's own pixels, grown.
        detections: What it shows of what was asked for.
        stand: Which of the robot's standing places it was taken from.
        way_m: How far the base had driven, turns counted by the distance that its wheels roll.
    """

    image: CameraImage
    points: Array
    robot: NDArray[np.bool_]
    detections: tuple[Shown, ...]
    stand: int
    way_m: float

    @property
    def eye(self) -> Array:
        """(3,) where the camera was."""
        return self.image.T_world_camera[:3, 3]

    @property
    def measured(self) -> NDArray[np.bool_]:
        """(H, W) bool: pixels of the surroundings that have a depth."""
        return (self.image.depth > 0) & ~self.robot

    @property
    def floor(self) -> NDArray[np.bool_]:
        """(H, W) bool: pixels of the floor."""
        return np.asarray(self.points[..., 2] < FLOOR_M)

    def of(self, mask: NDArray[np.bool_]) -> Array:
        """(n, 3) points of a mask."""
        return self.points[mask & self.measured]

    def cut(self, mask: NDArray[np.bool_]) -> bool:
        """Whether a mask is cut by the edge of the picture or, before the head, by the robot's own arms."""
        edge = mask[:2].any() or mask[-2:].any() or mask[:, :2].any() or mask[:, -2:].any()
        return bool(edge) or (self.image.camera == "head" and bool((grown(mask, _OWN_PX) & self.robot).any()))

    def depth_at(self, p_world: Array) -> tuple[float, float] | None:
        """(depth of a point, depth measured there) [m], or None if it is out of the picture or nothing was measured."""
        p = matmul(kin.inverse(self.image.T_world_camera), np.append(p_world, 1.0))
        if p[2] < 0.05:
            return None
        u = int(self.image.K[0, 0] * p[0] / p[2] + self.image.K[0, 2])
        v = int(self.image.K[1, 1] * p[1] / p[2] + self.image.K[1, 2])
        height, width = self.image.depth.shape
        if not (2 <= u < width - 2 and 2 <= v < height - 2) or self.robot[v, u]:
            return None
        seen = float(np.median(self.image.depth[v - 1 : v + 2, u - 1 : u + 2]))
        return (float(p[2]), seen) if seen > 0 else None


class Pictures:
    """The newest pictures, and the driving between them.

    Attributes:
        frames: The pictures, the newest last.
        stand: Number of the standing place where the robot is now.
        way_m: How far the base has driven [m], turns counted by the distance that its wheels roll.
        changes: How often pixels of a picture were found to be the robot's, or its payload's.
    """

    def __init__(self, detector: Detector, phrases: Iterable[str]) -> None:
        """Keep no picture yet; `detector` looks for `phrases`, and for the switches of what they name."""
        self._detector = detector
        self._phrases = (*phrases, *map(switch_of, phrases))
        self.frames: list[Frame] = []
        self.stand, self.way_m, self.changes = 0, 0.0, 0
        self._stood = np.full(3, np.inf)

    def feel(self, felt: Proprioception) -> None:
        """Take in one step of proprioception: the base may have moved to another standing place."""
        moved = felt.base_pose - self._stood
        if norm(moved[:2]) > _KEEPING.moved[0] or abs(kin.wrap(moved[2])) > _KEEPING.moved[1]:
            if self.stand:
                turned = robot_named(felt.robot).base.turn_m * abs(float(kin.wrap(moved[2])))
                self.way_m += float(np.hypot(*moved[:2])) + turned
            self.stand, self._stood = self.stand + 1, felt.base_pose.copy()

    def add(self, image: CameraImage, felt: Proprioception) -> Frame:
        """Take in a picture."""
        frame = take(image, felt, self._detector, self._phrases, self.stand, self.way_m)
        self.frames = [*self.frames, frame][-_KEEPING.kept :]
        return frame

    def give_to_robot(self, frame: Frame, pixels: NDArray[np.bool_] | tuple[NDArray[np.intp], ...]) -> None:
        """Count pixels of a picture as the robot's own: they show its payload."""
        frame.robot[pixels] = True
        self.changes += 1

    def head(self) -> list[Frame]:
        """The pictures of the head."""
        return [f for f in self.frames if f.image.camera == "head"]

    def here(self) -> list[Frame]:
        """The newest pictures of the head from this place, or else from the last one."""
        head = self.head()
        here = [f for f in head if f.stand == self.stand] or [f for f in head if f.stand == head[-1].stand]
        return here[-_KEEPING.carved :]

    def before(self) -> list[Frame]:
        """The newest pictures of the head from other places near by, which may show more than those from here."""
        here = self.here()
        stand = here[-1].stand if here else self.stand
        return [f for f in self.passed() if f.stand != stand][-_KEEPING.carved :]

    def passed(self) -> list[Frame]:
        """The pictures of the head from the last meter of driving."""
        return [f for f in self.head() if self.way_m - f.way_m < _KEEPING.passed_m]


def take(
    image: CameraImage, felt: Proprioception, detector: Detector, phrases: Sequence[str], stand: int, way_m: float
) -> Frame:
    """A picture taken in: where the camera is follows from the joints alone."""
    import cv2

    base = kin.base(felt.base_pose)
    camera = robot_named(felt.robot).camera_poses(felt.torso, felt.arm)[image.camera]
    # Single pixels are noisy. What stands out from its neighbors by more than noise is an edge, or thin, and stays; a
    # hole stays a hole: nothing is known there.
    near = cv2.medianBlur(np.ascontiguousarray(image.depth, np.float32), 3)
    smooth = (image.depth > 0) & (np.abs(near - image.depth) < DEPTH_NOISE.pixel_m * image.depth**2)
    depth = np.where(smooth, near, image.depth).astype(np.float32)
    image = replace(image, T_world_camera=matmul(base, camera), depth=depth)
    found = [Shown(d.phrase, pixels(d, image)) for d in detector.detect(image, [ROBOT, *phrases])]
    own = np.zeros(image.depth.shape, bool)
    for shown in found:
        if shown.phrase == ROBOT:
            own |= shown.mask
    points = image.points_world()
    if not getattr(detector, "knows_robot", False):
        things_px = np.any([shown.mask for shown in found if shown.phrase != ROBOT] or [np.zeros_like(own)], axis=0)
        own |= own_body(points, felt) & ~things_px
    own = grown(own, _OWN_PX, np.ones((3, 3), bool))
    things = tuple(replace(s, mask=_without_background(s.mask, image)) for s in found if s.phrase != ROBOT)
    return Frame(image, points, own, things, stand, way_m)


def grown(mask: NDArray[np.bool_], by_px: int, about: NDArray[np.bool_] | None = None) -> NDArray[np.bool_]:
    """(H, W) bool: a mask grown by some pixels, each time to the neighbors that `about` (3, 3) marks; None: to four."""
    rows, columns = (np.flatnonzero(mask.any(axis)) for axis in (1, 0))
    out = mask.copy()
    if len(rows):
        window = tuple(np.s_[max(at[0] - by_px, 0) : at[-1] + 1 + by_px] for at in (rows, columns))
        out[window] = ndimage.binary_dilation(mask[window], about, iterations=by_px)
    return out


def _without_background(mask: NDArray[np.bool_], image: CameraImage) -> NDArray[np.bool_]:
    """(H, W) bool: a mask without background pixels at its edge, mostly those of a wall."""
    rows, columns = np.nonzero(mask)
    if not len(rows):
        return mask
    window = np.s_[max(rows.min() - 1, 0) : rows.max() + 2, max(columns.min() - 1, 0) : columns.max() + 2]
    own, depth = mask[window], image.depth[window]
    edge = own & ~ndimage.binary_erosion(own, np.ones((3, 3), bool))
    nearest = ndimage.minimum_filter(np.where(own & (depth > 0), depth, np.inf), 3, mode="nearest")
    kept = mask.copy()
    kept[window] &= ~(edge & (depth - nearest > _STEEP * depth / float(image.K[0, 0])))
    return kept
