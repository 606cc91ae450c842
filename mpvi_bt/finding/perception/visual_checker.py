"""The visual checker: it judges a criterion from a labeled depth picture and what earlier ones showed in place."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import ConvexHull, QhullError

from mpvi_bt.executive.completion.criteria import UNARY, Criterion, Relation, named, parse
from mpvi_bt.finding.perception.between_fingers import hand_points
from mpvi_bt.finding.perception.detector import SWITCH
from mpvi_bt.ground.geometry.kinematics import inverse
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm, principal_axes
from mpvi_bt.ground.geometry.next_to import NEXT_TO_GAP
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Judgement
from mpvi_bt.ground.robot.default_robot import DEFAULT_ROBOT
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.ground.words.phrases import Vocabulary

ROBOT = "robot"
_STAYS: tuple[Relation, ...] = (
    "inside",
    "ontop",
    "nextto",
)  # relations that last while nothing is taken away; our choice
_TOUCHING_PX = 5  # of a hand where it touches a thing, or nearly so


@dataclass(frozen=True)
class Eyesight:
    """What counts as seen. Our choice."""

    seen_px: int = 15  # a thing with fewer pixels than this is not seen
    reach_m: float = 0.05  # half height and half depth of the space at the fingertips where a held thing must be [m]
    gap_m: float = 0.003  # fingers closer than this have nothing between them [m]
    touch_m: float = 0.03  # neighboring pixels this close in space belong to things that touch [m]
    covers_m: float = 0.15  # largest distance of a hand before what it may hold [m]
    covers: float = 0.2  # part of the hand's outline along which that must be so [ratio]
    held_m: float = 0.5  # a longer thing is not held when an arm across it hides the hand [m]
    beside_m: float = 0.06  # hands this close to both sides of a thing press it, under a lid that hides how [m]
    hangs_m: float = 0.1  # a thing hangs in the air if the view right below it is this far behind it [m]
    rim_m: float = 0.06  # largest height of a thing inside above the container's rim, if its own size is less [m]
    rest_m: float = 0.03  # tolerance between a thing's lowest visible points and its support [m]
    share: float = 0.5  # part of the visible thing that must be in place [ratio]
    light_px: int = 4  # a switch with fewer pixels than this is not seen
    hollow_m: float = 0.12  # the view into an open thing is this far behind its outline [m]
    # largest distance from the robot's camera to a thing it is at, seen from above [m]: the handoff distance and the
    # slack of navigation before a wide table
    at_m: float = 1.25
    # least hollow part of an open thing, and largest of a closed one (a handle is hollow) [ratio]
    hollow_share: tuple[float, float] = (0.05, 0.01)
    part: float = 0.12  # a part at the picture's edge tells nothing if it covers less of the edge than this [ratio]


class VisualChecker:
    """Judges places and open parts from one picture's colors, depth and labels (implements `Checker`).

    Where several things are counted in, on or next to others, as in "two candles are in wicker baskets", a thing that
    this picture does not show counts if the last picture that showed it showed it there. One at least has to be seen.

    The label image stands in for an open-vocabulary detector: no pose, contact or other simulator state is read. What
    it does not see or understand is a no, with the reason, as a false yes costs more than a false no (Paper,
    Completion Checker appendix).

    Attributes:
        name: "visual".
        needs_image: Yes.
    """

    name = "visual"
    needs_image = True

    def __init__(
        self,
        phrases: Mapping[str, Iterable[str]],
        eyesight: Eyesight | None = None,
        robot: RobotDescription | None = None,
    ) -> None:
        """Take the vocabulary.

        Args:
            phrases: Label of each thing to what people call it.
            eyesight: What counts as seen.
            robot: Whose cameras took the pictures; None: the default robot.
        """
        self._phrases = {name: tuple(called) for name, called in phrases.items()}
        self._eyesight, self._robot = eyesight or Eyesight(), robot or robot_named(DEFAULT_ROBOT)
        self._placed: dict[str, tuple[Relation, str]] = {}  # where things were when they were last seen, if in place

    def check(self, criterion: str, image: CameraImage | None) -> Judgement:
        """Whether the picture shows that `criterion` is met."""
        asked = parse(criterion)
        if asked is None:
            return Judgement(False, f"not a criterion that it understands: {criterion[:80]!r}")
        if image is None or image.labels is None:
            return Judgement(False, "no labeled picture to look at")
        picture = _SeenPicture(image, self._phrases, self._eyesight, self._robot)
        for name in list(self._placed):
            if not picture.shows_there(name, *self._placed[name]):
                del self._placed[name]
        subjects = picture.meant(asked.subject) if asked.relation == "at" else picture.visible(asked.subject)
        if not subjects:
            return Judgement(False, f"no {asked.subject} in the picture")
        if asked.relation == "closed":  # "the cabinet is closed" is not so while another is seen open
            ajar = [seen for s in subjects if (seen := picture.alone(s, replace(asked, relation="open"))).complete]
            if ajar:
                return Judgement(False, ajar[0].reason)
        if asked.relation in UNARY:
            return _judge(asked, [picture.alone(s, asked) for s in subjects])
        objects = picture.visible(asked.object)
        if not objects:
            return Judgement(False, f"no {asked.object} in the picture")
        if (look := picture.look(asked.relation)) is None:
            return Judgement(False, f"no picture tells whether {asked.subject} is {asked.relation}")
        looks = {s: {o: look(s, o) for o in objects if o != s} for s in subjects}
        before = self._seen_before(asked, subjects)
        if asked.relation in _STAYS:
            for name, there in looks.items():
                self._placed.update((name, (asked.relation, o)) for o, judged in there.items() if judged.complete)
        return _judge(asked, [_best(list(there.values())) for there in looks.values()], before)

    def _seen_before(self, asked: Criterion, now: Iterable[str]) -> int:
        """How many of the things asked for, but those seen now, were last seen where they are to be."""
        places = {(asked.relation, name) for name in named(asked.object, self._phrases)}
        others = set(named(asked.subject, self._phrases)) - set(now)
        return sum(self._placed.get(name) in places for name in others)


def _judge(asked: Criterion, looks: list[Judgement], before: int = 0) -> Judgement:
    """Enough of the things, or the reason of one that is not; `before`: how many more were seen so before."""
    so = [look for look in looks if look.complete]
    if so and len(so) + before >= asked.count:
        if asked.count == 1:
            return so[0]
        return Judgement(True, f"{len(so)} seen" if len(so) >= asked.count else f"{len(so)} seen, {before} before")
    reason = next(look.reason for look in looks if not look.complete) if len(so) < len(looks) else "no more are visible"
    return Judgement(False, reason if asked.count == 1 else f"{len(so)} of {asked.count}: {reason}")


def _best(looks: list[Judgement]) -> Judgement:
    return next((look for look in looks if look.complete), looks[0] if looks else Judgement(False, "nothing else seen"))


class _SeenPicture:
    """One picture, by what it shows."""

    def __init__(
        self, image: CameraImage, phrases: Mapping[str, Iterable[str]], eyesight: Eyesight, robot: RobotDescription
    ) -> None:
        assert image.labels is not None
        self._image, self._phrases, self._sight, self._robot = image, phrases, eyesight, robot
        self._labels = np.where(image.depth > 0, image.labels, -1)
        self._points = image.points_world()
        self._ids: dict[str, list[int]] = {}
        for label in np.unique(self._labels):
            if label in image.names:
                self._ids.setdefault(image.names[label], []).append(int(label))

    def visible(self, phrase: str) -> list[str]:
        """Names of the things called so of which enough is seen."""
        return list(filter(self._seen, named(phrase, self._phrases)))

    def meant(self, phrase: str) -> list[str]:
        """As `visible`, of the things that a phrase means by any of its words: "the other shoe" is some shoe."""
        return list(filter(self._seen, Vocabulary(self._phrases).named(phrase)))

    def look(self, relation: Relation) -> Callable[[str, str], Judgement] | None:
        """What judges a relation of two things; None if no picture tells."""
        looks: dict[Relation, Callable[[str, str], Judgement]] = {
            "inside": self.inside,
            "ontop": self.ontop,
            "nextto": self.nextto,
            "under": self.under,
        }
        return looks.get(relation)

    def shows_there(self, name: str, relation: Relation, other: str) -> bool:
        """Whether a thing is still in place, or the picture does not show it."""
        if not self._seen(name):
            return True
        look = self.look(relation)
        return look is not None and self._seen(other) and look(name, other).complete

    def alone(self, name: str, asked: Criterion) -> Judgement:
        """Whether a relation holds that takes one thing."""
        if asked.relation == "at":
            return self._near(name)
        if asked.relation == "held":
            return self.held(name, asked)
        if asked.relation == "lifted":
            return self._lifted(name)
        if asked.relation in ("open", "closed"):
            return self._open(name, asked.relation == "open")
        if asked.relation in ("on", "off"):
            return self._lit(name, asked.relation == "on")
        if asked.relation == "there":
            return Judgement(True, f"{name} is seen")
        return Judgement(False, f"no picture tells whether {name} is {asked.relation}")

    def held(self, name: str, asked: Criterion) -> Judgement:
        """Whether a hand has the thing between its fingers: the wrist camera's, or any in the head's picture."""
        camera = self._image.camera
        if camera == "head":
            if asked.side is not None:
                return Judgement(False, "the head camera does not tell the hands apart")
            return self._lifted(name)
        if asked.side not in (None, camera):
            return Judgement(False, f"the {camera} wrist camera does not see the {asked.side} gripper")
        return self._between_fingers(name)

    def inside(self, name: str, container: str) -> Judgement:
        """Whether most that is seen of the thing lies within the container's outline and not far above its rim."""
        thing, walls = self._points[self._mask(name)], self._points[self._mask(container)]
        lowest, highest = np.percentile(walls, 1, axis=0), np.percentile(walls, 99, axis=0)
        size = float(np.ptp(thing, axis=0).max())
        within = ((thing[:, :2] > lowest[:2]) & (thing[:, :2] < highest[:2])).all(1)
        low = thing[:, 2] < highest[2] + min(size, self._sight.rim_m)
        if np.mean(within) < self._sight.share:
            return Judgement(False, f"{name} is seen beside {container}")
        if np.mean(within & low) < self._sight.share:
            return Judgement(False, f"{name} is seen above {container}")
        if self._lifted(name).complete or (self._gripped(name) and np.median(thing[:, 2]) > highest[2]):
            return Judgement(False, f"{name} is seen in a gripper in or above {container}")
        return Judgement(True, f"{name} is seen inside {container}")

    def ontop(self, name: str, surface: str) -> Judgement:
        """Whether the thing's lowest visible points are level with a horizontal part of the surface around them."""
        if self._may_be_held(name):
            return Judgement(False, f"{name} is seen in a gripper")
        thing, support = self._points[self._mask(name)], self._points[self._mask(surface)]
        bottom = float(np.percentile(thing[:, 2], 2))
        lowest, highest = thing[:, :2].min(0) - 0.15, thing[:, :2].max(0) + 0.15
        near = support[((support[:, :2] > lowest) & (support[:, :2] < highest)).all(1)]
        near = near[near[:, 2] < bottom + self._sight.rest_m]
        if len(near) < self._sight.seen_px:
            return Judgement(False, f"no part of {surface} is seen under {name}")
        level = float(np.percentile(near[:, 2], 95))
        face = near[near[:, 2] > level - 0.015]
        # A horizontal face has an extent both ways; the edge of a wall has not.
        spread = principal_axes(face[:, :2])[0] if len(face) > 2 else np.zeros(2)
        if abs(bottom - level) > self._sight.rest_m or spread.min() < 0.01:
            return Judgement(False, f"{name} does not rest on {surface}")
        return Judgement(True, f"{name} is seen on {surface}")

    def nextto(self, name: str, other: str) -> Judgement:
        """Whether the gap between what is seen of the two is small for their size, and they are at one height.

        Boxes of round or slanting things overlap at a corner that is empty: there the other thing is seen at the
        height of the first, and not over or under its middle.
        """
        for either in (name, other):  # of two sandals a hand may hold the one that is asked for second
            if self._may_be_held(either):
                return Judgement(False, f"{either} is seen in a gripper")
        if self._hangs(name):
            return Judgement(False, f"{name} is seen in the air")
        a, b = self._box(name), self._box(other)
        gap = np.maximum(0.0, np.maximum(a[0], b[0]) - np.minimum(a[1], b[1]))
        if gap[2] > self._sight.rest_m or norm(gap) > NEXT_TO_GAP * np.mean(np.ptp(a, axis=0) + np.ptp(b, axis=0)):
            return Judgement(False, f"{name} is seen away from {other}")
        middle, points = a.mean(0), self._points[self._mask(other)]
        if ((b[0] < middle) & (middle < b[1]))[:2].all():
            level = (points[:, 2] > middle[2]) & (points[:, 2] < a[1, 2])
            column = (np.abs(points - middle) < np.ptp(a, axis=0) / 4)[:, :2].all(1)
            if np.count_nonzero(level) < self._sight.seen_px or np.count_nonzero(column) >= self._sight.seen_px:
                return Judgement(False, f"{name} is seen in, on or under {other}, not beside it")
        return Judgement(True, f"{name} is seen next to {other}")

    def under(self, name: str, other: str) -> Judgement:
        """Whether a part of the other thing is seen over most of it."""
        if self._may_be_held(name):
            return Judgement(False, f"{name} is seen in a gripper")
        thing, cover = self._points[self._mask(name)], self._points[self._mask(other)]
        over = cover[cover[:, 2] > np.percentile(thing[:, 2], 98)]
        if len(over) < self._sight.seen_px:
            return Judgement(False, f"nothing of {other} is seen above {name}")
        low, high = over[:, :2].min(0), over[:, :2].max(0)
        if np.mean(((thing[:, :2] > low) & (thing[:, :2] < high)).all(1)) < self._sight.share:
            return Judgement(False, f"{name} is not seen beneath {other}")
        lowest, highest = thing[:, :2].min(0) - self._sight.reach_m, thing[:, :2].max(0) + self._sight.reach_m
        if np.count_nonzero(((over[:, :2] > lowest) & (over[:, :2] < highest)).all(1)) < self._sight.seen_px:
            return Judgement(False, f"{other} is seen around {name}, not over it")
        return Judgement(True, f"{name} is seen under {other}")

    def _near(self, name: str) -> Judgement:
        """Judge by the horizontal distance from the head to the visible part. A carried thing is never near."""
        if self._image.camera != "head":
            return Judgement(False, "only the head camera tells where the robot is")
        held = [other for other in self._phrases if self._seen(other) and self._gripped(other)]
        if name in held or any(self.inside(name, other).complete for other in held):
            return Judgement(False, f"{name} is seen to be carried")
        gap = np.percentile(norm(self._points[self._mask(name)][:, :2] - self._eye[:2], axis=1), 5)
        near = bool(gap <= self._sight.at_m)
        return Judgement(near, f"{name} is seen {'within reach' if near else 'far off'}")

    def _lit(self, name: str, wanted: bool) -> Judgement:
        """By the light of its switch: green while it is on, red while it is off."""
        red, green = self._image.rgb[self._mask(name + SWITCH)][:, :2].astype(float).T
        if len(red) < self._sight.light_px:
            return Judgement(False, f"the switch of {name} is not seen")
        lit = float(np.median(green - red)) > 0
        return Judgement(lit is wanted, f"the light of {name} is seen {'green' if lit else 'red'}")

    def _open(self, name: str, wanted: bool) -> Judgement:
        """Judge by a view of the inside: how far visible points lie behind the convex outline of all visible points.

        Our choice: of an open door, drawer or lid one sees the inside, or what it has left free; a closed one is convex
        but for its handles. A tall door that is ajar by less than a third, seen from the side of its hinge, hides what
        is behind it and passes for closed; not so the side of a fridge, or a box's lid, at the edge of the picture.
        """
        mask = self._mask(name)
        points = self._points[mask]
        points = points[:: max(1, len(points) // 3000)]
        try:
            hull = ConvexHull(points).equations
        except QhullError:
            return Judgement(False, f"too little of {name} is seen")
        eye = self._eye
        rays = points - eye
        distance = norm(rays, axis=1)
        toward = matmul(rays / distance[:, None], hull[:, :3].T)  # (points, faces)
        with np.errstate(divide="ignore", invalid="ignore"):
            hits = np.where(toward < -1e-6, -(matmul(hull[:, :3], eye) + hull[:, 3]) / toward, 0.0)
        hollow = float(np.mean(distance - hits.max(1) > self._sight.hollow_m))
        least, most = self._sight.hollow_share
        if hollow >= least:
            return Judgement(wanted, f"one sees into {name}")
        cut = mask[[0, -1]].any() or mask[:, [0, -1]].any()
        if hollow <= most and not (cut and mask.mean() < self._sight.part):
            return Judgement(not wanted, f"{name} is seen closed")
        return Judgement(False, f"the picture does not tell whether {name} is {'open' if wanted else 'closed'}")

    @property
    def _eye(self) -> Array:
        """(3,) where the camera is."""
        return self._image.T_world_camera[:3, 3]

    def _seen(self, name: str) -> bool:
        return bool(np.count_nonzero(self._mask(name)) >= self._sight.seen_px)

    def _box(self, name: str) -> Array:
        """(2, 3) lowest and highest of what is seen of it."""
        return np.percentile(self._points[self._mask(name)], (1, 99), axis=0)

    def _mask(self, name: str) -> NDArray[np.bool_]:
        return np.isin(self._labels, self._ids.get(name, []))

    def _between_fingers(self, name: str) -> Judgement:
        """In a wrist picture: points of the thing between the fingers, at their tips."""
        points, tcp_m = hand_points(self._image, self._robot)
        tip = np.abs(points - (0.0, 0.0, tcp_m - 0.01))
        at_tips = (tip[..., 0] < self._sight.reach_m) & (tip[..., 2] < self._sight.reach_m)
        beyond_palm = (tip[..., 0] < 0.02) & (points[..., 2] > tcp_m - 0.04)
        fingers = points[self._mask(ROBOT) & at_tips & beyond_palm][:, 1]
        high = self._robot.opening_m / 2
        low = -high
        if (fingers < 0).any() and (fingers > 0).any():
            low, high = float(np.percentile(fingers[fingers < 0], 98)), float(np.percentile(fingers[fingers > 0], 2))
        if high - low < self._sight.gap_m:
            return Judgement(False, "the gripper is seen closed on nothing")
        across = points[..., 1]
        between = self._mask(name) & at_tips & (across > low) & (across < high)
        if np.count_nonzero(between) < self._sight.seen_px:
            return Judgement(False, f"{name} is not seen between the fingers")
        return Judgement(True, f"{name} is seen between the fingers")

    def _lifted(self, name: str) -> Judgement:
        """In a head picture: the thing touches the robot's hand, and what is under it is not near it.

        What is pressed between two hands below its lid hides where they touch it: then they are beside it on both
        sides, and it hangs in the air.
        """
        if not self._gripped(name) and not (self._flanked(name) and self._hangs(name)):
            return Judgement(False, f"{name} is not seen in a gripper")
        mask = self._mask(name)
        rows, columns = np.nonzero(mask)
        last = rows >= np.percentile(rows, 90)
        below = np.minimum(rows[last] + 2, mask.shape[0] - 1), columns[last]
        others = ~mask[below] & ~self._mask(ROBOT)[below]
        gaps = norm(self._points[below] - self._points[rows[last], columns[last]], axis=1)[others]
        if len(gaps) and np.nanmedian(gaps) < self._sight.touch_m:
            return Judgement(False, f"{name} is seen to rest on something")
        return Judgement(True, f"{name} is seen in a gripper")

    def _may_be_held(self, name: str) -> bool:
        """Whether a hand is seen on a thing, or right before a good part of it: its fingers may be around that."""
        touching, outline = self._borders(name, self._sight.covers_m)
        return self._gripped(name) or touching > self._sight.covers * outline or self._parted(name)

    def _parted(self, name: str) -> bool:
        """Whether an arm cuts a thing of payload size in two in the picture. The hidden middle may be the hand."""
        mask, robot = self._mask(name), self._mask(ROBOT)
        if float(np.ptp(self._box(name), axis=0).max()) > self._sight.held_m:
            return False
        parts, count = ndimage.label(mask)
        sizes = np.bincount(parts.ravel(), minlength=count + 1)
        large = [k for k in range(1, count + 1) if sizes[k] >= self._sight.seen_px]
        whole, _ = ndimage.label(mask | robot)
        return len(large) > len({int(whole[parts == k][0]) for k in large})

    def _flanked(self, name: str) -> bool:
        """Whether the robot is seen right beside a thing to its left and to its right."""
        to_camera = inverse(self._image.T_world_camera)
        seen = (self._points[self._mask(label)] for label in (name, ROBOT))
        thing, robot = (matmul(points, to_camera[:3, :3].T) + to_camera[:3, 3] for points in seen)
        (low, high), near = np.percentile(thing, (1, 99), axis=0), self._sight.beside_m
        level = robot[((robot > low) & (robot < high))[:, 1:].all(1), 0]
        sides = (level > low[0] - near) & (level < low[0]), (level < high[0] + near) & (level > high[0])
        return all(np.count_nonzero(side) >= _TOUCHING_PX for side in sides)

    def _hangs(self, name: str) -> bool:
        """Whether the pixels right below a thing lie well behind it. Pixels of a thing in front of its foot do not."""
        mask, depth = self._mask(name), self._image.depth
        rows, columns = np.nonzero(mask)
        last = rows >= np.percentile(rows, 90)
        below = np.minimum(rows[last] + 2, mask.shape[0] - 1), columns[last]
        others = ~mask[below] & ~self._mask(ROBOT)[below] & (depth[below] > 0)
        behind = (depth[below] - depth[rows[last], columns[last]])[others]
        return bool(len(behind) and np.median(behind) > self._sight.hangs_m)

    def _gripped(self, name: str) -> bool:
        """Whether pixels of the robot border on the thing's, near them in space."""
        return self._borders(name, self._sight.touch_m)[0] >= _TOUCHING_PX

    def _borders(self, name: str, near_m: float) -> tuple[int, int]:
        """How often the robot is beside a thing's outline and so near it in space, and how often anything is."""
        mask, robot = self._mask(name), self._mask(ROBOT)
        rows, columns = np.nonzero(mask & ~ndimage.binary_erosion(mask, iterations=2))
        touching = outline = 0
        for dr, dc in ((-3, 0), (3, 0), (0, -3), (0, 3)):
            r, c = np.clip(rows + dr, 0, mask.shape[0] - 1), np.clip(columns + dc, 0, mask.shape[1] - 1)
            gap = norm(self._points[r, c] - self._points[rows, columns], axis=1)
            touching += int(np.count_nonzero(robot[r, c] & (gap < near_m)))
            outline += int(np.count_nonzero(~mask[r, c]))
        return touching, outline
