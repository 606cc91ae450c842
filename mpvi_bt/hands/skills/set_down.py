"""Setting down what two hands hold between them: the base drives it in over the surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array, bounds
from mpvi_bt.ground.robot.collision import Body
from mpvi_bt.ground.robot.motion import Actions, MotionFailure
from mpvi_bt.ground.robot.squeeze import squeezes
from mpvi_bt.hands.motion.both_hands import look_over, open_wide, raise_both, straighten_up
from mpvi_bt.hands.motion.carry import settle
from mpvi_bt.hands.motion.gaze import look_at
from mpvi_bt.hands.motion.work import NEAR_M, Perform, Words, Work
from mpvi_bt.hands.skills.box_grip import Box, seen_box
from mpvi_bt.hands.skills.placing import SETTING
from mpvi_bt.hands.skills.spots import floor_around, is_floor
from mpvi_bt.hands.stance.base_search import RUN_UPS_M, Alike, SearchBudget, about, behind, first, ranked
from mpvi_bt.hands.stance.stance_search import Search


@dataclass(frozen=True)
class DrivingIn:
    """How the base drives a box in over a surface, and the hands release it.

    Our choice, by how far two arms that press give way.
    """

    over_m: float = 0.05  # clearance of the box over the surface while it is driven in [m]
    around_m: float = 0.01  # clearance around the box on the surface [m]
    hands_m: float = 0.09  # room beside it, if there is any, for hands that release it and lift its neighbor later [m]
    headroom_m: float = 0.1  # clearance above the box [m]
    carried: float = 0.35  # middle part of the box's breadth that a narrower support has to bear [ratio]
    spots: int = 40  # spots that are checked
    headings: int = 16  # directions to drive in to each spot
    step_m: float = 0.08  # distance between two checks on the way in, for elbows that might meet a screen beside it [m]
    off_m: float = 1.3  # distance to which the base approaches a spot beyond the known room [m]
    leg_m: float = 1.2  # longest leg on the way there [m]
    legs: int = 4  # most legs on the way there
    far_m_s: float = 0.3  # speed of the base on the way there [m/s]
    in_m_s: float = 0.2  # speed of the base on the way in [m/s]
    lower_s_m: float = 7.0  # time for the hands to lower the box by a meter [s/m]
    rise_s_m: float = 3.0  # time for the hands to rise beside it by a meter [s/m]
    above_m: float = 0.08  # rise of the hands before the base draws them back [m]; lower, they would sweep things


_DRIVE_IN = DrivingIn()
_BEEN = Alike(0.05, 0.05)  # our choice: a base pose fails, too, that is so near to one that failed


def either(one: Perform, both: Perform) -> Perform:
    """The way of one hand or, while two hands hold a thing between them, the way of both."""

    def perform(work: Work, words: Words, tried: list[Array]) -> Actions:
        return (both if squeezes(work.motion.felt) else one)(work, words, tried)

    return perform


def set_down(work: Work, words: Words, tried: list[Array]) -> Actions:
    """Set the thing that both hands hold between them down on `words["surface"]`.

    Raises:
        MotionFailure: "not_held", "unknown_object", "no_free_spot", "no_stance", "slipped", "missed", or a motion's own
            reason.
    """
    scene, motion = work.scene, work.motion
    name = scene.between()
    if name is None or name not in {e.name for e in scene.knowledge().find(words["object"])}:
        raise MotionFailure("not_held")
    surface = None if is_floor(words["surface"]) else work.nearest(words["surface"])
    for _ in range(_DRIVE_IN.legs):
        if surface is not None:
            if scene.needs_looks and bounds(scene.solids(surface))[1, 2] < seen_box(work, name).bottom:
                yield from look_over(work)
            yield from look_at(work, surface)
        box = seen_box(work, name)
        radius, here = max(box.length, box.width) / 2 + _DRIVE_IN.around_m, motion.felt.base_pose[:2]
        if surface is None:
            # in view, and driven in from here
            ahead = box.middle[:2] + here - behind(motion.felt.base_pose, RUN_UPS_M[0])[:2]
            spots = floor_around(work, words["surface"], radius, box.height, ahead)
        else:
            apart = max(box.length / 2, box.width / 2 + _DRIVE_IN.hands_m) + _DRIVE_IN.around_m
            wide, close = (scene.spots(surface, r, box.height + _DRIVE_IN.headroom_m, here) for r in (apart, radius))
            spots = [*wide[: _DRIVE_IN.spots // 2], *close] or _on_the_middle(work, surface, box)
        search = work.search("right", {name})
        # What is far off may have room that is not seen from here.
        far_off = spots[0] if spots else None if surface is None else work.middle(surface)
        nearer = None if far_off is None else _toward(motion.felt.base_pose, far_off)
        route = None if nearer is None else search.route(motion.felt.base_pose, nearer)
        if route is None:
            break
        for base in route:
            yield from motion.drive(base, speed=_DRIVE_IN.far_m_s)
    if not spots:
        raise work.no_free_spot(name, surface)
    search.tried.extend(tried)
    found = _find_place(work, search, box, list(spots))
    if found is None:
        raise work.no_stance()
    base, spot, way = found
    tried.append(base)
    yield from raise_both(work, max(0.0, spot[2] + _DRIVE_IN.over_m - box.bottom))
    for pose in way:
        yield from motion.drive(pose, speed=_DRIVE_IN.far_m_s)
    if scene.between() != name:
        raise MotionFailure("slipped")
    yield from motion.drive(base, speed=_DRIVE_IN.in_m_s)
    yield from raise_both(
        work, spot[2] + SETTING.down_m - seen_box(work, name).bottom, seconds_per_m=_DRIVE_IN.lower_s_m
    )
    yield from motion.wait(0.2)
    yield from open_wide(work)
    yield from raise_both(work, _DRIVE_IN.above_m, seconds_per_m=_DRIVE_IN.rise_s_m)
    yield from motion.drive(way[-1], speed=_DRIVE_IN.far_m_s)
    yield from straighten_up(work)
    yield from settle(work, without={name} if surface is None else {name, surface})
    yield from look_at(work, name)
    if abs(min(s.aabb()[0, 2] for s in scene.solids(name)) - spot[2]) > SETTING.lost_m:
        raise MotionFailure("missed")


def _on_the_middle(work: Work, surface: str, box: Box) -> list[Array]:
    """Places (3,) for what is about as broad as its support, such as one box on another: those next to its middle."""
    radius, here = _DRIVE_IN.carried * min(box.length, box.width), work.motion.felt.base_pose[:2]
    spots = work.scene.spots(surface, radius, box.height + _DRIVE_IN.headroom_m, here)
    return sorted(spots, key=lambda spot: float(norm((spot - work.middle(surface))[:2])))


def _toward(here: Array, spot: Array) -> Array | None:
    """A base pose (3,) on the straight way to a spot that is too far off for what is known around; else None."""
    way = spot[:2] - here[:2]
    far = float(norm(way))
    if far < NEAR_M:
        return None
    return np.array([*(here[:2] + way * min(_DRIVE_IN.leg_m, far - _DRIVE_IN.off_m) / far), np.arctan2(way[1], way[0])])


def _find_place(work: Work, search: Search, box: Box, spots: list[Array]) -> tuple[Array, Array, list[Array]] | None:
    """A base pose (3,) from which the held box comes to stand on a spot (3,), that spot, and how to get behind it."""
    motion, some = work.motion, spots[: _DRIVE_IN.spots]
    held_at = matmul(kin.inverse(work.base), np.append(box.middle, 1.0))[:2]
    arms = {s: motion.arm(s) for s in motion.robot.sides}
    headings = 2 * np.pi * np.arange(_DRIVE_IN.headings) / _DRIVE_IN.headings
    headings = headings[ranked(np.abs(kin.wrap(headings - motion.felt.base_pose[2])))]
    bases = about(np.array(some)[:, None, :2], headings, *held_at).reshape(-1, 3)
    bases[:, 2] = kin.wrap(bases[:, 2])

    def check(k: int) -> tuple[tuple[Array, Array, list[Array]] | None, float]:
        base, spot = bases[k], some[k // len(headings)]
        if (way := search.way_behind(base, RUN_UPS_M, straight_in=True)) is None:
            search.refusals.add("no way there and straight in")
            return None, 0.0
        # Raised by then, as `raise_both` does: lower down the arms would meet the surface.
        lift = motion.posture[0] + max(0.0, spot[2] + _DRIVE_IN.over_m - box.bottom)
        torso = motion.bent(lift=float(np.clip(lift, *motion.robot.trunk.limits[0])))
        body = Body(motion.robot, torso, arms)
        if all(_clear(body, search, pose) for pose in _drive_in(way[-1], base)):
            return (base, spot, way), 1.0
        search.refusals.add("arm or trunk in the way")
        return None, 1.0

    return first(bases, check, _BEEN, search.tried, SearchBudget())


def _drive_in(back: Array, base: Array) -> Array:
    """(n, 3) base poses on the straight way in from `back` to `base`, the last one first: it is the most cramped."""
    return np.linspace(base, back, int(np.ceil(float(norm(base[:2] - back[:2])) / _DRIVE_IN.step_m)) + 1)


def _clear(body: Body, search: Search, base: Array) -> bool:
    """Whether trunk and arms, but for the fingers, are clear of everything from a base pose (3,)."""
    there = body.amid(search.around(base, touched=False))
    return there.trunk_free() and all(bool(there.free(side, q, grasping=True)[0]) for side, q in there.arms.items())
