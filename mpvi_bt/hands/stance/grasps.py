"""Grasp candidates of a two-finger hand on things of known shape: across two sides, on a rim, on a bar."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from mpvi_bt.finding.scene.scene import Scene
from mpvi_bt.finding.shapes.moving_parts import Bar
from mpvi_bt.ground.geometry.kinematics import hand_rotation, inverse, transform, wrap
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array, Solid, bounds
from mpvi_bt.ground.robot.collision import Surroundings
from mpvi_bt.ground.robot.hand import Hand


@dataclass(frozen=True)
class Pinch:
    """How a thing is pinched.

    Our choice, by things of the tasks: fingers close straight, and draw along what they touch first.
    """

    spare_m: float = 0.035  # opening beyond the width of the thing, both sides together [m]
    before_m: float = 0.05  # farthest that the fingers close before the middle of a thing that is deep for the palm [m]
    long_m: float = 0.05  # a thing that reaches farther from its middle is pinched nearer to its ends, too [m]
    nearer: tuple[float, float, float] = (0.0, 0.35, 0.7)  # parts of the way to its ends [ratio]
    nearer_cost: float = 3.0  # cost of each meter of that way; a thing that hangs from one end is heavy for the fingers
    part_cost: float = 0.1  # cost of a pinch of one part
    levels: int = 4  # heights of parts at which they may be pinched
    # offsets of the hand across the thing [m]; its wall is nearer than half a palm
    off_center_m: tuple[float, ...] = (0.006, -0.006, 0.012, -0.012)
    off_center_cost: float = 5.0  # cost of each meter of that offset; the closing hand draws the thing along
    gap_m: float = 0.004  # gap between a thing and the nearer finger [m]
    tilts_rad: tuple[float, ...] = (0.0, 0.3, 0.6, 0.9, 1.2, 1.4, np.pi / 2)  # tilts from straight down [rad]
    deep_m: float = 0.012  # least depth of the tcp below the top of the pinched part [m]
    low: float = 0.45  # least height of the tcp in it [ratio of its height]
    steep: float = 0.3  # least cosine of the tilt by which the room before the palm is projected
    margin_m: float = 0.004  # the tcp of a flat thing is at most this far over its top; also gap of top and palm [m]
    tilt_cost: float = 0.4  # cost of each radian of tilt
    before_cost: float = 3.0  # cost of each meter that the fingers close before the middle
    shallow_cost: float = 4.0  # cost of each meter that the tcp is less deep than `deep_m`
    aside_cost: float = 0.3  # cost of each radian that the hand comes from another side than the robot's
    same_m: float = 0.005  # tops that differ by less are one [m]
    # allowed overlap of fingers, and of the palm, with the rest of the thing [m]; spheres are larger
    slack_m: tuple[float, float] = (0.002, 0.008)
    step_m: float = 0.004  # distance between the checked points between the pads [m]
    upright: float = 0.95  # least cosine with the vertical of the axis of a round thing


_PINCH = Pinch()


@dataclass(frozen=True)
class BarGrasp:
    """How a bar is grasped.

    Our choice: level, straight from its free side, and not from beyond the thing.
    """

    turns_rad: tuple[float, ...] = (0.0, 0.4, -0.4, 0.8, -0.8, 1.2, -1.2)  # turns of the approach about the bar [rad]
    rising: float = 0.2  # largest upward part of the approach [sine]
    tilt_cost: float = 0.3  # cost of each radian of tilt from straight down
    turn_cost: float = 0.3  # cost of each radian of turn


_BAR = BarGrasp()


@dataclass(frozen=True)
class Rim:
    """How a vessel is pinched by its rim.

    Our choice, by bowls, baskets and bins.
    """

    opening_m: float = 0.056  # opening of the hand [m]
    depth_m: float = 0.018  # depth of the tcp below the rim, along the approach [m]
    wall_m: float = 0.03  # thicker walls are no rims [m]
    cost: float = 0.15  # cost beside a pinch of the whole
    tilts_rad: tuple[float, ...] = (0.0, 0.5, -0.5, 0.9, -0.9)  # tilts along the rim [rad]
    covers: float = 0.8  # cost of a hand right over the opening
    far_cost: float = 0.15  # cost of each radian around the rim from the robot's side
    tilt_cost: float = 0.4  # cost of each radian of tilt
    upright: float = 0.9  # least cosine with the vertical of the axis of an open vessel
    lid_m: tuple[float, float] = (0.01, 0.006)  # a lid is looked for this far inward of the edge and above it [m]
    below_m: float = 0.008  # the wall is looked for this far below the edge [m]
    from_m: float = 0.004  # from this far within the volume [m]
    to_m: float = 0.002  # to this far beyond the thickest wall [m]
    step_m: float = 0.001  # in these steps [m]
    least_m: float = 0.002  # least depth of the tcp below the rim [m]
    around: int = 16  # places around a round rim


_RIM = Rim()
_AROUND = (
    np.arange(-7, 9) * np.pi / 8
)  # our choice: headings from which a round thing is pinched: the robot may drive around it
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Grasp:
    """One way to take hold of a thing.

    Attributes:
        T_world_tcp: (4, 4) where the hand closes.
        tilt_rad: Of the approach from straight down; pi/2 is level.
        cost: Preference; smaller is better.
        opening_m: Between the fingers before they close.
    """

    T_world_tcp: Array
    tilt_rad: float
    cost: float
    opening_m: float


def grasps(scene: Scene, hand: Hand, name: str, bearing: float, off_center: bool = False) -> list[Grasp]:
    """Candidates for a thing; only the handles' if it has any.

    Args:
        scene: Where the thing is.
        hand: What takes it.
        name: The thing.
        bearing: Heading [rad] from the robot to it; hands come from the robot's side if they can.
        off_center: Pinches whose hand is not over the middle, instead of those whose hand is.
    """
    bars = scene.handles(name)
    if bars:
        return [g for bar in bars for g in _on_bar(hand, bar, bearing)]
    solids = list(scene.solids(name))
    volumes = scene.volumes(name)
    offs = _PINCH.off_center_m if off_center else (0.0,)
    found = _pinches(hand, scene.pose(name), solids, bearing, () if volumes else solids, offs)
    if volumes:  # a palm over the opening keeps what is inside from being poured out
        found = [replace(g, cost=g.cost + _RIM.covers * max(0.0, float(np.cos(g.tilt_rad)))) for g in found]
    for volume in volumes:
        found += _rims(hand, volume, solids, bearing)
    return found


def _on_bar(hand: Hand, bar: Bar, bearing: float) -> Iterator[Grasp]:
    """Toward the bar from its free side, closing across it."""
    ahead = np.array([np.cos(bearing), np.sin(bearing), 0.0])
    for turn in _BAR.turns_rad:
        approach = Rotation.from_rotvec(turn * bar.axis).apply(-bar.outward)
        if approach[2] > _BAR.rising:
            continue
        tilt = float(np.arccos(np.clip(-approach[2], -1, 1)))
        # a hand does not come from beyond the thing
        aside = max(0.0, -float(matmul(approach, ahead))) * float(np.sin(tilt))
        across = np.cross(bar.axis, approach)
        for sign in (1.0, -1.0):
            T = transform(hand_rotation(approach, sign * across), bar.center)
            cost = _BAR.tilt_cost * tilt + _BAR.turn_cost * abs(turn) + aside
            yield Grasp(T, tilt, cost, hand.opening_m)


def _pinches(
    hand: Hand, T: Array, solids: Sequence[Solid], bearing: float, parts: Sequence[Solid], offs: Sequence[float]
) -> list[Grasp]:
    """Between two sides of a thing, from straight above to level; of `parts` of it too, which may be narrower."""
    inside = Surroundings(solids)
    tops = sorted({round(float(solid.aabb()[1, 2]), 2) for solid in solids}, reverse=True)
    support = float(min(s.aabb()[0, 2] for s in solids))
    out = list(_between_sides(hand, T, solids, bearing, support, tops[: _PINCH.levels], inside, offs))
    for part in parts if len(solids) > 1 and not _round(solids) else ():
        found = _between_sides(hand, part.T, [part], bearing, support, (), inside, offs)
        out += [replace(g, cost=g.cost + _PINCH.part_cost) for g in found if _clear(hand, g, inside)]
    return out


def _round(solids: Sequence[Solid]) -> bool:
    """Whether a thing is as wide from all sides."""
    return all(s.kind == "sphere" for s in solids) or all(
        s.kind == "cylinder" and abs(s.T[2, 2]) > _PINCH.upright for s in solids
    )


def _between_sides(
    hand: Hand, T: Array, solids: Sequence[Solid], bearing: float, support: float, levels: Sequence[float],
    inside: Surroundings, offs: Sequence[float],
) -> Iterator[Grasp]:  # fmt: skip
    """Between two sides of the box about solids along the axes of `T`; of a long one nearer to its ends, too.

    `support` is the height of what the thing lies on, `levels` are those of lower tops that a pinch may go down to,
    `inside` is the whole thing, and `offs` are how far the hand is off its middle, along its closing axis [m].
    """
    frame = inverse(T)
    low, high = bounds(s.moved(frame) for s in solids)
    size, middle = high - low, matmul(T[:3, :3], (low + high) / 2) + T[:3, 3]
    up = int(np.abs(T[2, :3]).argmax())
    flat = [i for i in range(3) if i != up]
    top, bottom = float(middle[2] + size[up] / 2), float(middle[2] - size[up] / 2)
    headings: list[tuple[float, float, float]] = []  # heading of the approach, half depth along it, width across it
    if _round(solids):
        width = float(size[flat[0]])
        if width <= hand.widest_m:
            headings = [(bearing + turn, width / 2, width) for turn in _AROUND]
    else:
        for i, j in (flat, flat[::-1]):
            if size[i] <= hand.widest_m:
                closing = T[:3, i]
                heading = float(np.arctan2(-closing[0], closing[1]))
                headings += [(heading + flip, float(size[j]) / 2, float(size[i])) for flip in (0.0, np.pi)]
    for heading, half, width in headings:
        aside = abs(float(wrap(heading - bearing)))
        ahead = np.array([np.cos(heading), np.sin(heading), 0.0])
        for nearer in half * np.array(
            _PINCH.nearer if half > _PINCH.long_m and not _round(solids) else _PINCH.nearer[:1]
        ):
            for tilt in _PINCH.tilts_rad:
                for level in (top, *(z for z in levels if z < top - _PINCH.same_m)):
                    heights = (support, bottom, top, level)
                    grasp = _pinch(hand, middle - nearer * ahead, heights, heading, tilt, half - nearer, width)
                    if grasp is not None and _between(hand, grasp.T_world_tcp, inside):
                        cost = grasp.cost + _PINCH.aside_cost * aside + _PINCH.nearer_cost * nearer
                        grasp = replace(grasp, cost=cost)
                        yield from (_moved(grasp, off) for off in offs if abs(off) < _most(grasp, width))
                        break


def _most(grasp: Grasp, width: float) -> float:
    """How far off the middle of a thing so wide a hand may be, less than this [m]: both fingers stay beside it."""
    return max(1e-9, (grasp.opening_m - width) / 2 - _PINCH.gap_m)


def _moved(grasp: Grasp, off: float) -> Grasp:
    """The same with the hand moved along its closing axis."""
    T = grasp.T_world_tcp.copy()
    T[:3, 3] += off * T[:3, 1]
    return replace(grasp, T_world_tcp=T, cost=grasp.cost + _PINCH.off_center_cost * abs(off))


def _clear(hand: Hand, grasp: Grasp, inside: Surroundings) -> bool:
    """Whether open fingers and palm are clear of the rest of a thing."""
    T = grasp.T_world_tcp
    return all(
        bool((inside.distance(matmul(centers, T[:3, :3].T) + T[:3, 3]) > radii - slack).all())
        for (centers, radii), slack in zip((hand.fingers(grasp.opening_m), hand.palm), _PINCH.slack_m, strict=True)
    )


def _between(hand: Hand, T_world_tcp: Array, inside: Surroundings) -> bool:
    """Whether something of a thing is between the fingers' pads: over a part of it that juts out there may be none."""
    y = np.arange(-hand.widest_m / 2, hand.widest_m / 2 + 1e-9, _PINCH.step_m)
    pads = T_world_tcp[:3, 3] + hand.pad_m * T_world_tcp[:3, 2] + y[:, None] * T_world_tcp[:3, 1]
    return bool((inside.distance(pads) <= 0).any())


def _pinch(hand: Hand, middle: Array, heights: tuple[float, float, float, float], heading: float, tilt: float,
           radius: float, width: float) -> Grasp | None:  # fmt: skip
    """One pinch, as deep as palm and support allow; None if the thing is too flat or too deep for it.

    `heights` are those of what the thing lies on, the underside and the top of what is pinched, and the top of what is
    to be between the fingers.
    """
    support, bottom, top, level = heights
    s, c = float(np.sin(tilt)), float(np.cos(tilt))
    z = top - max(_PINCH.deep_m, (hand.room_m - radius * s) / max(c, _PINCH.steep))
    z = min(max(z, bottom + _PINCH.low * (top - bottom)), level - _PINCH.deep_m)
    z = max(z, support + hand.lowest(tilt))
    if z > top + _PINCH.margin_m:
        return None
    before = max(0.0, radius * s + (top - z) * c - hand.room_m + _PINCH.margin_m)
    if before > _PINCH.before_m:
        return None
    approach = np.array([np.cos(heading) * s, np.sin(heading) * s, -c])
    p = np.array([middle[0], middle[1], z]) - before * approach
    R = hand_rotation(approach, np.array([-np.sin(heading), np.cos(heading), 0.0]))
    cost = _PINCH.tilt_cost * tilt + _PINCH.before_cost * before
    cost += _PINCH.shallow_cost * max(0.0, z - top + _PINCH.deep_m)
    return Grasp(transform(R, p), tilt, cost, min(hand.opening_m, width + _PINCH.spare_m))


def _rims(hand: Hand, volume: Solid, solids: Sequence[Solid], bearing: float) -> Iterator[Grasp]:
    """Across the upright wall around a volume, one finger inside, one outside, from above."""
    R, half = volume.T[:3, :3], volume.half_m
    up = R[:, 2] * np.sign(R[2, 2])
    if up[2] < _RIM.upright:
        return
    rim = volume.T[:3, 3] + up * half[2]
    inner_floor = float(rim[2] - 2 * half[2])
    support = float(min(s.aabb()[0, 2] for s in solids))
    wall = Surroundings(solids)
    within, above = _RIM.lid_m
    covered = max(0.0, min(1.0, hand.palm_reach_m / float(half[:2].min()) - 1.0))  # none of a bowl, nearly all of a cup
    for edge, outward in _edges(volume):
        if wall.distance((rim + edge - within * outward + above * up)[None])[0] <= 0:
            continue  # a lid is on it
        reach = np.arange(-_RIM.from_m, _RIM.wall_m + _RIM.to_m, _RIM.step_m)
        inside = wall.distance(rim + edge - _RIM.below_m * up + reach[:, None] * outward) <= 0
        if not inside.any():
            continue
        first = int(inside.argmax())
        rest = ~inside[first:]
        if not rest.any():
            continue  # thicker than a hand would take for a wall
        middle = float(reach[first] + reach[first + int(rest.argmax())]) / 2
        at = rim + edge + middle * outward
        far = abs(float(wrap(np.arctan2(outward[1], outward[0]) - bearing - np.pi)))
        for tilt in _RIM.tilts_rad:
            # So deep along the fingers: deeper, slanted ones would meet a round rim where they cross it.
            deep = _RIM.depth_m * float(np.cos(tilt))
            z = max(float(at[2]) - deep, max(support, inner_floor) + hand.lowest(abs(tilt)))
            if z > at[2] - _RIM.least_m:
                continue
            approach = -np.cos(tilt) * _UP + np.sin(tilt) * np.cross(_UP, outward)
            for sign in (1.0, -1.0):
                T = transform(hand_rotation(approach, sign * outward), np.array([at[0], at[1], z]))
                cost = _RIM.cost + _RIM.far_cost * far + _RIM.tilt_cost * abs(tilt) + _RIM.covers * covered
                yield Grasp(T, abs(tilt), cost, _RIM.opening_m)


def _edges(volume: Solid) -> Iterator[tuple[Array, Array]]:
    """Places on the upper edge of a volume, from its middle (3,), with the direction out of it (3,)."""
    R, half = volume.T[:3, :3], volume.half_m
    if volume.kind == "cylinder":
        for a in 2 * np.pi * np.arange(_RIM.around) / _RIM.around:
            outward = matmul(R, [np.cos(a), np.sin(a), 0.0])
            yield outward * half[0], outward
        return
    for i, j in ((0, 1), (1, 0)):
        for sign in (1.0, -1.0):
            outward = sign * R[:, i]
            for along in (0.0, 0.5, -0.5):
                yield outward * half[i] + along * half[j] * R[:, j], outward
