"""How to stand at a base pose: a torso posture and an arm path from which the hand can do what it has to.

Reach alone is not enough: every waypoint of the hand is reachable without a jump of the elbow; the arm, the idle arm,
what is held, head and chest are clear of everything. What is cheap to refute comes first: postures, then paths.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot import arm_motion
from mpvi_bt.ground.robot.collision import Body
from mpvi_bt.ground.robot.protocol import Side, other
from mpvi_bt.hands.stance.glance import MARGIN_M, TOUCH_M, Glance, after, free
from mpvi_bt.hands.stance.refusals import deepest
from mpvi_bt.hands.stance.site import Site, Standing
from mpvi_bt.hands.stance.stance import Option, Stance


@dataclass(frozen=True)
class PostureParameters:
    """Which postures are checked from one base pose.

    Our choice: as many as keep a search below some seconds; cheap checks come first and are more.
    """

    pitches_rad: tuple[float, ...] = (0.0, 0.25, 0.5, 0.8, 1.1)  # pitches of the trunk [rad]
    ranked: int = 1200  # postures that are checked at the work place
    checked: int = 16  # remaining postures that are checked on the whole way


_POSTURE = PostureParameters()
# Our choice, of the arm's way to where the hand works, the wide berth first: in motion it runs up to 2 cm off its path.
WAY_MARGINS_M = (0.03, 0.005)


def stance_at(
    site: Site, lane: Array, route: list[Array], options: Sequence[Option], able: Sequence[int], hold: list[Array]
) -> tuple[Stance | None, bool]:
    """A stance at the end of a lane that leads straight in; and whether looking for it took more than a glance.

    Args:
        site: Where to work.
        lane: (n, 3) base poses. At the first the arm takes its posture, at the last the hand works.
        route: Base poses (3,) to drive to the lane by.
        options: Ways to do it.
        able: Indices of those to try.
        hold: Postures (7,) that bring the other hand, with what it holds, out of the way; empty if it holds nothing.
    """
    base = lane[-1]
    T = kin.inverse(kin.base(base))
    ends = np.cumsum([len(options[k].waypoints) for k in able])
    goals = np.split(matmul(T, np.concatenate([options[k].waypoints for k in able])), ends[:-1])
    keys = [min(options[k].contact, len(options[k].waypoints) - 1) for k in able]
    key_goals = np.stack([g[key] for g, key in zip(goals, keys, strict=True)])
    near = site.around(base, touched=True)
    trunks = site.torsos_amid(_POSTURE.pitches_rad, near)
    if not len(trunks[0]):
        trunk = site.body(site.motion.torso, near).trunk
        site.refusals.add("trunk in the way", partial(deepest, near, *trunk, kin.base(base)))
        return None, False
    torsos, t, g, q = site.postures(key_goals, [options[k].cost for k in able], trunks, swivels=12)
    if not len(q):
        site.refusals.add("out of reach")
        return None, False
    arms = {s: site.motion.arm(s) for s in site.motion.robot.sides}
    behind = site.around(lane[0], touched=True)
    if site.other is not None:
        arms[site.other] = hold[-1]
        if not site.body(site.motion.torso, behind, arms).free(site.other, hold[-1])[0]:
            site.refusals.add("other hand in the way")
            return None, False
    t, g, q = t[: _POSTURE.ranked], g[: _POSTURE.ranked], q[: _POSTURE.ranked]
    touching = np.array([options[k].contact == key for k, key in zip(able, keys, strict=True)])
    rows = np.flatnonzero(_clear(site, base, torsos, t, q, touching[g], arms))
    glance = Glance(site, base, behind, arms, torsos, [options[k] for k in able], goals, keys, t, g, q)
    checked = 0
    standing: dict[int, Standing | None] = {}
    for row in glance.passed(rows):
        if checked >= _POSTURE.checked:
            break
        where = (int(t[row]), int(g[row]))
        torso, k, key = torsos[t[row]], able[where[1]], keys[where[1]]
        checked += 1
        if where[0] not in standing:
            standing[where[0]] = site.stood(torso, behind, arms)
        if standing[where[0]] is None:
            standing[where[0]] = site.stood(torso, behind, arms, goals[where[1]][0])
        stood = standing[where[0]]
        if stood is None:
            continue
        path = _reached(site, stood.body, lane, options[k], goals[where[1]], key, q[row])
        if path is not None:
            return Stance(base, torso, k, path, goals[where[1]], hold, stood.level, route, options[k].opening_m), True
    if not len(rows):
        first = site.body(torsos[t[0]], near, arms)
        site.refusals.add("arm in the way", partial(_met, replace(first, arms={site.side: q[0]}), base))
    elif any(standing.values()):
        site.refusals.add("no path of the arm")
    else:
        site.refusals.add("torso cannot get there" if standing else "no free line of the hand")
    return None, len(rows) > 0


def _met(body: Body, base: Array) -> Array:
    """(4,) the sphere of a body that meets something at a base pose (3,)."""
    return deepest(body.around, *body.whole(), kin.base(base))


def _clear(site: Site, base: Array, torsos: Array, t: NDArray[np.intp], q: Array, touching: NDArray[np.bool_],
           arms: Mapping[Side, Array]) -> NDArray[np.bool_]:  # fmt: skip
    """(n,) bool: postures q (n, 7) with torsos `t` (n,) that are clear where the hand works, the trunk too."""
    out = np.zeros(len(q), bool)
    bare = {s: h.load for s, h in site.held.items() if s != site.side}
    near, loose = site.around(base, touched=True), site.around(base, touched=False)
    for k in np.unique(t):
        body = site.body(torsos[k], near, arms)
        rows = np.flatnonzero((t == k) & touching)
        out[rows] = body.amid(loose, bare).free(site.side, q[rows], -TOUCH_M, grasping=True)
        rows = np.flatnonzero((t == k) & ~touching)
        out[rows] = body.free(site.side, q[rows], MARGIN_M)
    return out


def _reached(
    site: Site, body: Body, lane: Array, option: Option, goals: Array, key: int, q_key: Array
) -> list[Array] | None:
    """The arm's path to the first waypoint if all of them, and the way in, are reachable and free.

    What has something in it or on it is not tipped on its way to where it is set down. (How a vessel gets to where it
    is poured out is planned apart.)
    """
    base = lane[-1]
    level: list[Array] | None = None
    sets_down = site.side in site.held and option.contact < len(goals)
    if sets_down and site.held[site.side].laden:
        level = arm_motion.plan_level(body, site.side, goals[0])
        if level is None or not free(site, body, base, option, 0, level[-1])[0]:
            return None
        key, q_key = 0, level[-1]
    postures: dict[int, Array] = {key: q_key}
    for order in (range(key - 1, -1, -1), range(key + 1, len(goals))):
        for k in order:
            line = arm_motion.trace(body.robot, body.torso, site.side, postures[k + 1 if k < key else k - 1], goals[k])
            if line is None or not free(site, body, base, option, k, line[-1])[0]:
                return None
            postures[k] = line[-1]
    if len(lane) > 1:
        last = replace(body, held=after(site, body, option)) if option.contact < len(goals) else body
        if not _leads(site, body, lane, postures[0], touched=True):
            return None
        if not _leads(site, last, lane, postures[len(goals) - 1], touched=option.load is None, slack=TOUCH_M):
            return None
    if level is not None:
        return level
    for margin in WAY_MARGINS_M:
        path = arm_motion.plan(body, site.side, postures[0], site.rng, margin)
        if path is not None:
            return path
    return None


def _leads(site: Site, body: Body, lane: Array, q: Array, touched: bool, slack: float = 0.0) -> bool:
    """Whether the robot, its arm in posture `q`, is clear of everything all along a lane."""
    idle = other(site.side)
    arms = {**body.arms, site.side: q}
    led = replace(body, arms=arms)
    for base in lane:
        there = led.amid(site.around(base, touched))
        if not (there.trunk_free() and there.free(site.side, q, -slack, grasping=slack > 0)[0]
                and (idle not in arms or there.clearance(idle, arms[idle])[0][0] > 0)):  # fmt: skip
            return False
    return True
