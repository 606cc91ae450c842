"""How a box that is too wide for one hand is pressed between two: from where, and in which postures."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array, Solid, bounds
from mpvi_bt.ground.robot import arm_motion
from mpvi_bt.ground.robot.collision import Body
from mpvi_bt.ground.robot.hand import Hand
from mpvi_bt.ground.robot.model import SIGN
from mpvi_bt.ground.robot.motion import MotionFailure
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.hands.motion.both_hands import BENDING
from mpvi_bt.hands.motion.gaze import look_at
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.stance.base_search import RUN_UPS_M, Alike, SearchBudget, about, behind, first, ranked
from mpvi_bt.hands.stance.stance_search import Search


@dataclass(frozen=True)
class Squeeze:
    """Where a box is pressed between two open hands.

    Our choice, by boxes, baskets and trays of the tasks.
    """

    widest_m: float = 0.46  # widest box that goes between the arms [m]; the narrowest is as wide as one hand opens
    height: float = 0.55  # height at which its sides are pressed [ratio of its height]; above half, so that it hangs
    lowest_m: float = 0.05  # least height of the hands, for the fingers' sake [m]
    low_m: float = 0.07  # a lower box is taken with hands that point down [m]
    slant_rad: float = 0.75  # their least angle from level [rad]; a tip broader than the side slips on its edge
    edge_m: float = 0.005  # clearance of a fingertip from the support of the box, and from its side's upper edge [m]
    wide_m: float = 0.05  # clearance of each hand from its side before both close in [m]; the base is no more precise


_SQUEEZE = Squeeze()


@dataclass(frozen=True)
class TwoHandedStances:
    """Which base poses, torsos and postures of both arms are searched to take a box.

    Our choice: as many as keep a search below some seconds, the nearest first.
    """

    # distance from the middle of the base ahead to the near side of the box, and left to its middle [m]
    places_m: tuple[tuple[float, float], ...] = tuple(product((0.31, 0.35, 0.39, 0.43, 0.47), (0.0, 0.05, -0.05)))
    # the same, used if there is no room for any of the others [m]
    rare_places_m: tuple[tuple[float, float], ...] = (
        *product((0.52, 0.57, 0.62), (0.0, 0.05, -0.05, 0.1, -0.1)),
        *product((0.31, 0.35, 0.39, 0.43, 0.47), (0.1, -0.1)),
    )
    best_m: float = 0.37  # most comfortable distance ahead [m]
    off_best: float = 1.5  # cost of each meter off it [m of driving]
    turn_m: float = 0.4  # cost of each radian of turning [m of driving]
    bases: int = 24  # base poses that are checked for postures of both arms
    torsos: int = 8  # torsos of each base pose
    postures: int = 6  # postures of each arm for each torso
    swivels: int = 16  # positions of each elbow
    arm_cost: float = 0.05  # cost of each radian that a joint is off its posture for traveling
    pitch_cost: float = 0.6  # cost of each radian of the trunk's pitch
    lift_gain: float = 0.2  # gain of each meter that the trunk is raised
    margin_m: float = 0.01  # clearance of the arms while they form behind the box [m]
    legs: int = 3  # drives around a thing, to where its far sides are known


_STANCES = TwoHandedStances()
_BEEN = Alike(0.03, 0.3)  # our choice: a base pose fails, too, that is so near to one that failed


@dataclass(frozen=True, eq=False)
class Box:
    """The upright box about a thing: middle (3,), full length along `heading`, width across it, and height [m]."""

    middle: Array
    heading: float
    length: float
    width: float
    height: float

    @property
    def bottom(self) -> float:
        """Height of its underside [m]."""
        return float(self.middle[2]) - self.height / 2

    def hands(self, hand: Hand, reach: float) -> dict[Side, Array]:
        """T_world_tcp (4, 4) of hands on both sides, seen from behind; `reach` [m] off the sides, negative within."""
        flatness, z = 1.0, max(_SQUEEZE.lowest_m, _SQUEEZE.height * self.height)
        if self.height < _SQUEEZE.low_m:
            room = max(0.0, self.height / 2 - _SQUEEZE.edge_m)
            flatness = min(float(np.cos(_SQUEEZE.slant_rad)), room / hand.tip_half_m)
            z = max(self.height / 2, _SQUEEZE.edge_m + flatness * hand.tip_half_m)
        along = np.array([np.cos(self.heading), np.sin(self.heading), 0.0])
        leftward = np.array([-along[1], along[0], 0.0])
        steepness = np.sqrt(1 - flatness**2)
        out: dict[Side, Array] = {}
        for side in SIDES:
            sign = SIGN[side]
            approach = -sign * leftward * flatness - np.array([0, 0, steepness])
            tip = np.array([*self.middle[:2], self.bottom + z]) + sign * leftward * (self.width / 2 + reach)
            out[side] = kin.transform(kin.hand_rotation(approach, along), tip - hand.tip_m * approach)
        return out


@dataclass(frozen=True, eq=False)
class BoxGrip:
    """Where to stand and how to press: a base pose, the one straight behind it where the hands are formed, base poses
    on the way there, a torso, and postures of the arms wide and touching.
    """

    box: Box
    base: Array
    back: Array
    torso: Array
    arms: Mapping[Side, list[Array]]
    way: Sequence[Array] = ()


def find_grip(work: Work, name: str, tried: Sequence[Array]) -> Generator[Array, None, tuple[BoxGrip, Search]]:
    """A grip, from where its stances are known: if need be it drives around the thing.

    Raises:
        MotionFailure: "unknown_object", "no_grasp", "no_stance", or a motion's own reason.
    """
    motion = work.motion
    narrowest = motion.robot.hand.opening_m  # less is for one hand
    for leg in range(_STANCES.legs + 1):
        yield from look_at(work, name)
        sides = boxes_about(work.scene.pose(name), carcass(work, name))
        boxes = [box for box in sides if narrowest < box.width < _SQUEEZE.widest_m]
        if not boxes:
            raise MotionFailure("no_grasp")
        search = work.search("right", work.along(name))
        search.tried.extend(tried)
        here = motion.felt.base_pose
        usual, rare = (_bases(here, boxes, places) for places in (_STANCES.places_m, _STANCES.rare_places_m))
        if (grip := _find(work, search, *usual) or _find(work, search, *rare)) is not None:
            return grip, search
        far = np.stack([behind(base, RUN_UPS_M[0]) for base in usual[0]])
        way = search.toward(far) if leg < _STANCES.legs else None
        if way is None:
            break
        for pose in way:
            yield from motion.drive(pose)
    raise work.no_stance()


def carcass(work: Work, name: str) -> list[Solid]:
    """A thing's solids without its doors and lids: pressed between two hands a lid would rise and leave the rest."""
    leaves = [leaf for door in work.scene.doors(name) for leaf in door.solids]
    solids = list(work.scene.solids(name))
    return [s for s in solids if not any(np.allclose(s.T, leaf.T) for leaf in leaves)] or solids


def boxes_about(T: Array, solids: list[Solid]) -> Iterator[Box]:
    """The box about a thing's solids as seen from each of its four sides."""
    up = int(np.abs(T[2, :3]).argmax())
    ahead = T[:3, (up + 1) % 3]
    yaw = float(np.arctan2(ahead[1], ahead[0]))
    frame = kin.transform(kin.rot_z(yaw), T[:3, 3])
    low, high = bounds(s.moved(kin.inverse(frame)) for s in solids)
    middle = matmul(frame[:3, :3], (low + high) / 2) + frame[:3, 3]
    x, y, z = (high - low).tolist()
    for quarter in range(4):
        length, width = (x, y) if quarter % 2 == 0 else (y, x)
        yield Box(middle, float(kin.wrap(yaw + quarter * np.pi / 2)), length, width, z)


def seen_box(work: Work, name: str) -> Box:
    """The box about a thing as the robot sees it that holds it before itself."""
    yaw = float(work.motion.felt.base_pose[2])
    boxes = boxes_about(work.scene.pose(name), list(work.scene.solids(name)))
    return min(boxes, key=lambda b: abs(float(kin.wrap(b.heading - yaw))))


def _bases(here: Array, boxes: list[Box], places: Sequence[tuple[float, float]]) -> tuple[Array, list[Box]]:
    """(n, 3) base poses to take a thing from, at these places as seen from each of its sides, the nearest first.

    Each with the box as seen from that side. Our choice: the base always faces a side. Turned by 0.35 rad from that, 2
    of 30 lifts held.
    """
    ahead, aside = np.tile(np.array(places).T, len(boxes))
    side = np.repeat(np.arange(len(boxes)), len(places))
    middle, heading = np.array([box.middle for box in boxes])[side], np.array([box.heading for box in boxes])[side]
    bases = about(middle, heading, np.array([box.length for box in boxes])[side] / 2 + ahead, aside)
    way, turn = norm(bases[:, :2] - here[:2], axis=1), np.abs(kin.wrap(heading - here[2]))
    cost = way + _STANCES.turn_m * turn + np.abs(aside) + _STANCES.off_best * np.abs(ahead - _STANCES.best_m)
    order = ranked(cost)
    return bases[order], [boxes[k] for k in side[order]]


def _find(work: Work, search: Search, bases: Array, boxes: list[Box]) -> BoxGrip | None:
    """The first good grip, from base poses (n, 3) each of which faces a side of a box."""

    def check(k: int) -> tuple[BoxGrip | None, float]:
        if (way := search.way_behind(bases[k], RUN_UPS_M, straight_in=True)) is None:
            search.refusals.add("no way there and straight in")
            return None, 0.0
        if (grip := _grip_at(work, search, bases[k], way[-1], boxes[k])) is None:
            search.refusals.add("no posture of both arms")
            return None, 1.0
        return replace(grip, way=way), 1.0

    return first(bases, check, _BEEN, search.tried, SearchBudget(_STANCES.bases))


def _grip_at(work: Work, search: Search, base: Array, back: Array, box: Box) -> BoxGrip | None:
    """A torso and postures of both arms for one base pose and the one behind it."""
    to_base = kin.inverse(kin.base(base))
    robot = work.motion.robot
    touching, wide = box.hands(robot.hand, 0.0), box.hands(robot.hand, _SQUEEZE.wide_m)
    postures = robot.postures(BENDING.pitches_rad, float(robot.trunk.posture(robot.travel_torso)[3]))
    torsos = robot.trunk.joints(postures)
    chests = kin.inverse(robot.chest(torsos))
    found: dict[Side, dict[int, list[Array]]] = {}
    for side in SIDES:
        at, q = robot.arm_inverse(matmul(chests, to_base, touching[side]), side, swivels=_STANCES.swivels)
        cost = robot.limit_cost(q, side) + _STANCES.arm_cost * np.abs(q - robot.travel_arm[side]).sum(1)
        found[side] = {}
        for row in np.argsort(cost):
            found[side].setdefault(int(at[row]), []).append(q[row])
    shared = sorted(
        set(found["left"]) & set(found["right"]),
        key=lambda t: _STANCES.pitch_cost * postures[t, 2] - _STANCES.lift_gain * postures[t, 0],
    )
    loose, all_around = search.around(base, touched=False), search.around(base, touched=True)
    rear = search.around(back, touched=True)
    for t in shared[: _STANCES.torsos]:
        torso = torsos[t]
        arms: dict[Side, list[Array]] = {}
        for side in SIDES:
            body = Body(robot, torso, {**robot.travel_arm, **{s: p[0] for s, p in arms.items()}}, {}, loose)
            some = np.array(found[side][t][: _STANCES.postures])
            for q in some[body.free(side, some, grasping=True)]:
                line = arm_motion.trace(robot, torso, side, q, matmul(to_base, wide[side]))
                if (
                    line is not None
                    and body.amid(all_around).free(side, line[-1], grasping=True)[0]
                    and body.amid(rear).free(side, line[-1], margin=_STANCES.margin_m)[0]
                ):
                    arms[side] = [line[-1], q]
                    break
        bodies = [Body(robot, torso, {s: p[k] for s, p in arms.items()}, {}, loose) for k in range(2)]
        if len(arms) == 2 and all(
            body.free(side, arms[side][k], grasping=True)[0] for side in SIDES for k, body in enumerate(bodies)
        ):
            return BoxGrip(box, base, back, torso, arms)
    return None
