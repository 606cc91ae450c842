"""What is too wide for one hand: a box is pressed from both sides with open hands, raised and carried."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from mpvi_bt.manipulation.motion.approach import APPROACH
from mpvi_bt.manipulation.motion.gaze import look_at
from mpvi_bt.manipulation.motion.work import Words, Work
from mpvi_bt.manipulation.stance.stance_search import Search
from mpvi_bt.robot import arm_motion
from mpvi_bt.robot import kinematics as kin
from mpvi_bt.robot.collision import Body
from mpvi_bt.robot.hand import Hand
from mpvi_bt.robot.linear_algebra import matmul, norm
from mpvi_bt.robot.model import SIGN, RobotModel
from mpvi_bt.robot.motion import GRIP, Actions, MotionFailure
from mpvi_bt.robot.protocol import CONTROL_HZ, SIDES, ActionLayout, Side
from mpvi_bt.robot.solids import Array, Solid, bounds
from mpvi_bt.robot.squeeze import pressing, squeezes


@dataclass(frozen=True)
class Squeeze:
    """How a box is pressed between two open hands, raised and let go.

    Our choice, by boxes, baskets and trays of the tasks.

    Attributes:
        widest_m: Widest box that goes between the arms [m]. The narrowest is as wide as one hand opens.
        height: Height at which its sides are pressed [ratio of its height]: a little over its middle, so that it hangs,
        lowest_m: but no lower than this, for the fingers' sake [m].
        low_m: A box that is lower is taken with hands that point down [m],
        slant_rad: at least this far from level [rad]: a tip broader than the side presses on its edge and slips.
        edge_m: Clearance of a fingertip from what the box stands on, and from the upper edge of its side [m].
        wide_m: Clearance of each hand from its side before both close in [m]: the base stands no more precisely.
        closing_m_s: Speed of each hand as it closes in, or draws off [m/s]: the first to touch hardly shifts the box.
        pressing_s: Time in which the hands build up force [s]: a longer rest looks like the end of the lift.
        lift_m: Lift of the box before the base draws it back [m].
        raise_s_m: Time in which the arms raise it by a meter [s/m].
        short_m: A lift that the trunk leaves short by more is finished by the arms [m].
        outward_m: How far each hand draws off sideways to let go [m].
        loose_m: Hands that have moved apart by less still hold the box [m].
        shares: Parts of a motion of both hands that are tried, where the arms cannot go all of it [ratio].
    """

    widest_m: float = 0.46
    height: float = 0.55
    lowest_m: float = 0.05
    low_m: float = 0.07
    slant_rad: float = 0.75
    edge_m: float = 0.005
    wide_m: float = 0.05
    closing_m_s: float = 0.12
    pressing_s: float = 0.2
    lift_m: float = 0.15
    raise_s_m: float = 5.0
    short_m: float = 0.004
    outward_m: float = 0.07
    loose_m: float = 0.05
    shares: tuple[float, ...] = (1.0, 0.75, 0.5, 0.25)


_SQUEEZE = Squeeze()


@dataclass(frozen=True)
class TwoHandedStances:
    """Which base poses, torsos and postures of both arms are looked at to take a box.

    Our choice: as many as keep a search below some seconds, the nearest first.

    Attributes:
        places_m: Distance from the middle of the base ahead to the near side of the box, and left to its middle [m].
        rare_places_m: The same, looked at where there is no room for any of the others.
        best_m: Most comfortable distance ahead [m];
        off_best: each meter off it costs as much as this many meters of driving,
        turn_m: and each radian of turning as this many [m].
        back_m: Run-up of the base, straight in; the longest for which there is room [m].
        been_m: A base pose this near to one that failed fails, too [m],
        been_rad: if it is turned alike up to this [rad].
        bases: Base poses that are checked for postures of both arms,
        torsos: torsos of each base pose,
        postures: and postures of each arm for each torso.
        swivels: Positions of each elbow.
        arm_cost: Cost of each radian that a joint is off its posture for traveling.
        pitch_cost: Cost of each radian that the trunk is bent,
        lift_gain: less so much for each meter that it is raised.
        margin_m: Clearance of the arms while they form behind the box [m].
        legs: Drives around a thing, to where its far sides are known.
    """

    places_m: tuple[tuple[float, float], ...] = tuple(product((0.31, 0.35, 0.39, 0.43, 0.47), (0.0, 0.05, -0.05)))
    rare_places_m: tuple[tuple[float, float], ...] = (
        *product((0.52, 0.57, 0.62), (0.0, 0.05, -0.05, 0.1, -0.1)),
        *product((0.31, 0.35, 0.39, 0.43, 0.47), (0.1, -0.1)),
    )
    best_m: float = 0.37
    off_best: float = 1.5
    turn_m: float = 0.4
    back_m: tuple[float, ...] = (0.4, 0.3, 0.2)
    been_m: float = 0.03
    been_rad: float = 0.3
    bases: int = 24
    torsos: int = 8
    postures: int = 6
    swivels: int = 16
    arm_cost: float = 0.05
    pitch_cost: float = 0.6
    lift_gain: float = 0.2
    margin_m: float = 0.01
    legs: int = 3


_STANCES = TwoHandedStances()


@dataclass(frozen=True)
class Bending:
    """How the body bends and straightens up with a box before it.

    Our choice: a grid over the trunk's range; the arms keep the hands level and have to reach them from there.

    Attributes:
        pitches_rad: Pitches of the trunk, the most upright first [rad].
        upright_rad: Pitches of a trunk that carries a box, or looks over one [rad].
        lifts_m: Lifts of the trunk, the most comfortable first [m].
        folded_m: Least lift while hands are folded before a bent trunk [m]: lower, they would meet the base.
        carry_m: Height of the hands above the floor to carry at, if the arms get there [m],
        shares: and parts of the way there, where they do not [ratio].
        steeper_rad: Least gain in how steeply the head looks down over a box [rad]: for less the trunk is not bent.
    """

    pitches_rad: tuple[float, ...] = (0.0, 0.25, 0.5, 0.8, 1.1, 1.35)
    upright_rad: tuple[float, ...] = (0.0, 0.25, 0.5, 0.8)
    lifts_m: tuple[float, ...] = (0.3, 0.42, 0.2, 0.55, 0.1)
    folded_m: float = 0.06
    carry_m: float = 0.62
    shares: tuple[float, ...] = (1.0, 0.6, 0.3)
    steeper_rad: float = 0.1


_BENDING = Bending()


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
class _Grip:
    """Where to stand and how to press: a base pose, the one straight behind it where the hands are formed, base poses
    on the way there, a torso, and postures of the arms wide and touching.
    """

    box: Box
    base: Array
    back: Array
    torso: Array
    arms: Mapping[Side, list[Array]]
    way: Sequence[Array] = ()


def lift(work: Work, words: Words, tried: list[Array]) -> Actions:
    """Take the thing that `words["object"]` names between both hands and raise it.

    Raises:
        MotionFailure: "unknown_object", "hands_full", "no_grasp", "no_stance", "not_squeezed", "slipped", or a motion's
            own reason.
    """
    scene, motion = work.scene, work.motion
    name = work.nearest(words["object"])
    if scene.between() == name:
        return  # in hand already
    if work.held() or squeezes(motion.felt):
        raise MotionFailure("hands_full")
    grip, search = yield from _near(work, name, tried)
    tried.append(grip.base)
    yield from together(motion.grip("left", 1.0, GRIP.empty_s), motion.grip("right", 1.0, GRIP.empty_s), motion_of=work)
    yield from _go_behind(work, grip, search)
    yield from motion.drive(grip.base, speed=APPROACH.inward_m_s)
    yield from _close_in(work, grip.box)
    yield from _press(work)
    if not squeezes(motion.felt):
        yield from open_wide(work)
        raise MotionFailure("not_squeezed")
    yield from raise_both(work, _SQUEEZE.lift_m)
    away = float(norm(grip.back[:2] - grip.base[:2]))
    yield from motion.drive(behind(motion.felt.base_pose, away), speed=APPROACH.inward_m_s)
    yield from straighten_up(work)
    yield from work.see("head")
    if not squeezes(motion.felt) or scene.between() != name:
        raise MotionFailure("slipped")


def _near(work: Work, name: str, tried: Sequence[Array]) -> Generator[Array, None, tuple[_Grip, Search]]:
    """A grip, from where its stances are known: if need be it drives around the thing. Raises as `lift`."""
    motion = work.motion
    narrowest = motion.robot.hand.opening_m  # less is for one hand
    for leg in range(_STANCES.legs + 1):
        yield from look_at(work, name)
        sides = boxes_about(work.scene.pose(name), _carcass(work, name))
        boxes = [box for box in sides if narrowest < box.width < _SQUEEZE.widest_m]
        if not boxes:
            raise MotionFailure("no_grasp")
        search = work.search("right", work.along(name))
        search.tried.extend(tried)
        here = motion.felt.base_pose
        usual, rare = (_bases(here, boxes, places) for places in (_STANCES.places_m, _STANCES.rare_places_m))
        if (grip := _find(work, search, usual) or _find(work, search, rare)) is not None:
            return grip, search
        way = search.toward(np.stack([behind(base) for base, _ in usual])) if leg < _STANCES.legs else None
        if way is None:
            break
        for pose in way:
            yield from motion.drive(pose)
    raise work.no_stance()


def _carcass(work: Work, name: str) -> list[Solid]:
    """A thing's solids without its doors and lids: pressed between two hands a lid would rise and leave the rest."""
    leaves = [leaf for door in work.scene.doors(name) for leaf in door.solids]
    solids = list(work.scene.solids(name))
    return [s for s in solids if not any(np.allclose(s.T, leaf.T) for leaf in leaves)] or solids


def together(*motions: Actions, motion_of: Work) -> Actions:
    """Motions of different parts of the body at the same time, until the last has ended."""
    going = list(motions)
    while going:
        going = [motion for motion in going if next(motion, None) is not None]
        if going:
            yield motion_of.motion.action.copy()


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


def _bases(here: Array, boxes: list[Box], places: Sequence[tuple[float, float]]) -> list[tuple[Array, Box]]:
    """Base poses (3,) to take a thing from, at these places as seen from each of its sides, the nearest first.

    Our choice: the base always faces a side. Turned by 0.35 rad from that, 2 of 30 lifts held.
    """
    ranked = []
    for box in boxes:
        for ahead, aside in places:
            offset = matmul(kin.rot_z(box.heading)[:2, :2], [box.length / 2 + ahead, aside])
            base = np.array([*(box.middle[:2] - offset), box.heading])
            turn = abs(float(kin.wrap(base[2] - here[2])))
            way = float(norm(base[:2] - here[:2]))
            cost = way + _STANCES.turn_m * turn + abs(aside) + _STANCES.off_best * abs(ahead - _STANCES.best_m)
            ranked.append((cost, base, box))
    return [(base, box) for _, base, box in sorted(ranked, key=lambda r: r[0])]


def _find(work: Work, search: Search, bases: list[tuple[Array, Box]]) -> _Grip | None:
    """The first good grip."""
    here, checked = work.motion.felt.base_pose, 0
    for base, box in bases:
        if any(_as_before(base, b) for b in search.tried):
            continue
        if (way := way_behind(search, here, base)) is None:
            search.refusals.add("no way there and straight in")
            continue
        if (grip := _grip_at(work, search, base, way[-1], box)) is not None:
            return replace(grip, way=way)
        search.refusals.add("no posture of both arms")
        checked += 1
        if checked >= _STANCES.bases:
            break
    return None


def _as_before(base: Array, before: Array) -> bool:
    """Whether a base pose (3,) is about the same as one that was tried."""
    near = norm(base[:2] - before[:2]) < _STANCES.been_m
    return bool(near and abs(kin.wrap(base[2] - before[2])) < _STANCES.been_rad)


def behind(base: Array, by_m: float = _STANCES.back_m[0]) -> Array:
    """The base pose (3,) from which the base drives straight in to another."""
    return base - [by_m * np.cos(base[2]), by_m * np.sin(base[2]), 0.0]


def way_behind(search: Search, here: Array, base: Array) -> list[Array] | None:
    """Base poses (3,) to drive to, the last as far straight behind `base` as there is room; None if there is no way."""
    for by_m in _STANCES.back_m:
        back = behind(base, by_m)
        if search.drivable(back, base) and (way := search.route(here, back)) is not None:
            return way
    return None


def _grip_at(work: Work, search: Search, base: Array, back: Array, box: Box) -> _Grip | None:
    """A torso and postures of both arms for one base pose and the one behind it."""
    to_base = kin.inverse(kin.base(base))
    robot = work.motion.robot
    touching, wide = box.hands(robot.hand, 0.0), box.hands(robot.hand, _SQUEEZE.wide_m)
    postures = robot.postures(_BENDING.pitches_rad, float(robot.trunk.posture(robot.travel_torso)[3]))
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
            for q in found[side][t][: _STANCES.postures]:
                line = arm_motion.trace(robot, torso, side, q, matmul(to_base, wide[side]))
                if line is None:
                    continue
                path = [line[-1], q]
                body = Body(robot, torso, {**robot.travel_arm, **{s: p[0] for s, p in arms.items()}}, {}, loose)
                open_body = Body(robot, torso, body.arms, {}, all_around)
                backed = Body(robot, torso, body.arms, {}, rear)
                if (
                    body.free(side, q, grasping=True)[0]
                    and open_body.free(side, path[0], grasping=True)[0]
                    and backed.free(side, path[0], margin=_STANCES.margin_m)[0]
                ):
                    arms[side] = path
                    break
        bodies = [Body(robot, torso, {s: p[k] for s, p in arms.items()}, {}, loose) for k in range(2)]
        if len(arms) == 2 and all(
            body.free(side, arms[side][k], grasping=True)[0] for side in SIDES for k, body in enumerate(bodies)
        ):
            return _Grip(box, base, back, torso, arms)
    return None


def _go_behind(work: Work, grip: _Grip, search: Search) -> Actions:
    """Form the arms some way before the box, where there is room."""
    motion = work.motion
    for pose in grip.way:
        yield from motion.drive(pose)
    trunk = motion.robot.trunk
    posture = np.append(trunk.posture(grip.torso)[:3], motion.posture[3])
    torso = trunk.joints(posture)
    posture[0] = max(posture[0], _BENDING.folded_m)  # bent as low as that, the folded hands would meet the base
    yield from motion.stand(trunk.joints(posture))
    around = search.around(grip.back, touched=True)
    for side in SIDES:
        body = replace(motion.body(), around=around)
        path = arm_motion.plan(body, side, grip.arms[side][0], work.rng)
        if path is None:
            raise MotionFailure("no_path")
        yield from motion.follow(side, path)
    yield from motion.stand(torso)


def _close_in(work: Work, box: Box) -> Actions:
    """Bring both hands to the sides, from where the base really stands."""
    to_base = kin.inverse(work.base)
    hands, speed = box.hands(work.motion.robot.hand, 0.0), _SQUEEZE.closing_m_s
    lines = [work.motion.line(side, matmul(to_base, hands[side]), speed, give_rad=np.inf) for side in SIDES]
    yield from together(*lines, motion_of=work)


def _press(work: Work) -> Actions:
    """Press with both hands straight toward each other."""
    motion = work.motion
    start = {side: motion.arm(side) for side in SIDES}
    told = pressing(motion.robot, motion.torso, start)
    n = round(_SQUEEZE.pressing_s * CONTROL_HZ)
    for k in range(1, n + 1):
        for side in SIDES:
            motion.action[ActionLayout.ARM[side]] = start[side] + (told[side] - start[side]) * k / n
        yield motion.still()
    yield motion.still()


def raise_both(work: Work, by_m: float, seconds_per_m: float = _SQUEEZE.raise_s_m) -> Actions:
    """Raise what is held, negative lowers, so that the squeeze stays: by the lift with the arms frozen, then by both
    arms or, where these cannot go so far, by bending or straightening up with the hands kept level.
    """
    motion = work.motion
    lift = motion.posture[0]
    target = float(np.clip(lift + by_m, *motion.robot.trunk.limits[0]))
    rest = by_m - (target - lift)
    if abs(target - lift) > 1e-3:
        yield from motion.stand(motion.bent(lift=target))
    if abs(rest) > _SQUEEZE.short_m:
        by = {side: np.array([0.0, 0.0, rest]) for side in SIDES}
        whole = yield from _shift(work, by, 1 / seconds_per_m, (1.0,))
        if not whole and not (yield from _bent(work, by, product(_BENDING.pitches_rad, _BENDING.lifts_m))):
            yield from _shift(work, by, 1 / seconds_per_m)


def straighten_up(work: Work) -> Actions:
    """Straighten up with the hands, and a box between them, kept level before the body, as far as the arms allow."""
    motion = work.motion
    height = float(motion.robot.tcp(motion.torso, motion.felt.arm["left"], "left")[2, 3])
    for share in _BENDING.shares:
        rise = max(0.0, _BENDING.carry_m - height) * share
        upright = [pitch for pitch in _BENDING.upright_rad if pitch <= motion.posture[2]]
        by = {side: np.array([0.0, 0.0, rise]) for side in SIDES}
        if (yield from _bent(work, by, product(upright, _BENDING.lifts_m))):
            return
    room = motion.robot.trunk.limits[0, 1] - motion.posture[0]
    yield from raise_both(work, max(0.0, min(room, _BENDING.carry_m - height)))


def look_over(work: Work) -> Actions:
    """Bring the head to where it sees over what both hands hold, that kept where it is, as near behind it as it can."""
    motion, name = work.motion, work.scene.between()
    if name is None:
        return
    box = bounds(s.moved(kin.inverse(work.base)) for s in work.scene.solids(name))
    far, top = box[1, 0], box[1, 2]

    def steepness(way: tuple[float, float]) -> float:
        torso = motion.robot.trunk.joints(np.array([way[1], 0.0, way[0], 0.0]))
        eye = motion.robot.head_camera(torso)[:3, 3]
        return float(np.arctan2(eye[2] - top, far - eye[0]))

    least = steepness((float(motion.posture[2]), float(motion.posture[0]))) + _BENDING.steeper_rad
    ways = [way for way in product(_BENDING.upright_rad, _BENDING.lifts_m) if steepness(way) > least]
    yield from _bent(work, dict.fromkeys(SIDES, np.zeros(3)), sorted(ways, key=steepness, reverse=True))


def _bent(work: Work, by: Mapping[Side, Array], ways: Iterable[tuple[float, float]]) -> Generator[Array, None, bool]:
    """Move both hands by (3,) in the base frame, turned as they are, while the body comes to the first pitch [rad] and
    lift [m] for which that can be done. Returns whether there was one.
    """
    motion = work.motion
    robot, felt = motion.robot, motion.felt
    body = replace(motion.body(), arms=dict(felt.arm))  # where the hands are, not where they press to
    now = {side: robot.tcp(motion.torso, felt.arm[side], side) for side in SIDES}
    paths = {s: arm_motion.glide(T, kin.transform(T[:3, :3], T[:3, 3] + by[s])) for s, T in now.items()}
    for pitch, lift in ways:
        torso = robot.trunk.joints(np.array([lift, 0.0, pitch, motion.posture[3]]))
        if (arms := arm_motion.sweep(body, torso, paths)) is not None:
            told = _pressed(robot, motion.torso, torso, arms) if squeezes(felt) else arms
            yield from motion.stand(torso, told, give_rad=np.inf)
            return True
    return False


def _pressed(robot: RobotModel, start: Array, end: Array, arms: Mapping[Side, list[Array]]) -> dict[Side, list[Array]]:
    """What arms are told that go on pressing along paths of postures (7,), while the torso moves from start to end."""
    n = len(arms["left"])
    torsos = start + (end - start) * np.linspace(0, 1, n)[:, None]
    told = [pressing(robot, torso, {s: arms[s][k] for s in SIDES}) for k, torso in enumerate(torsos)]
    return {side: [t[side] for t in told] for side in SIDES}


def open_wide(work: Work) -> Actions:
    """Take both hands off what they press, outward; where the arms cannot go there, with the body bent otherwise."""
    motion, outward = work.motion, {side: np.array([0.0, SIGN[side] * _SQUEEZE.outward_m, 0.0]) for side in SIDES}
    for side in SIDES:  # from where the hands are, not from where they press to
        motion.action[ActionLayout.ARM[side]] = motion.felt.arm[side]
    yield motion.still()
    start = _apart(work)
    with suppress(MotionFailure):  # hands that have let go, if not by the whole way, are good enough
        yield from _shift(work, outward, _SQUEEZE.closing_m_s)
    if _apart(work) - start < _SQUEEZE.loose_m:
        with suppress(MotionFailure):
            yield from _bent(work, outward, product(_BENDING.pitches_rad, _BENDING.lifts_m))


def _apart(work: Work) -> float:
    """Between the hands, as felt [m]."""
    felt = work.motion.felt
    left, right = (work.motion.robot.tcp(felt.torso, felt.arm[side], side)[:3, 3] for side in SIDES)
    return float(norm(left - right))


def _shift(
    work: Work, by: Mapping[Side, Array], speed: float, shares: Sequence[float] = _SQUEEZE.shares
) -> Generator[Array, None, bool]:
    """Move both hands along straight lines (3,) in the base frame, by the first of `shares` that both arms can go.

    Returns whether there was one.
    """
    motion = work.motion
    for share in shares:
        goals = {side: motion.hand(side) for side in SIDES}
        for side in SIDES:
            goals[side][:3, 3] += share * by[side]
        robot, torso = motion.robot, motion.torso
        if all(arm_motion.trace(robot, torso, side, motion.arm(side), goals[side]) is not None for side in SIDES):
            lines = [motion.line(side, goals[side], speed, give_rad=np.inf) for side in SIDES]
            yield from together(*lines, motion_of=work)
            return True
    return False
