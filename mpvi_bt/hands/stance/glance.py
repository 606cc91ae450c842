"""A glance at the ends of a hand's lines, at many postures at once, before the lines themselves are looked at."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.collision import Body, Load, Obstacles
from mpvi_bt.ground.robot.protocol import Side
from mpvi_bt.hands.stance.site import Site
from mpvi_bt.hands.stance.stance import Option

MARGIN_M = 0.012  # our choice: clearance of the arm at the work place
TOUCH_M = 0.008  # our choice: spheres reach that far beyond what they stand for: what may be near a hand that touches


@dataclass(frozen=True)
class GlanceParameters:
    """How many postures are glanced at from one base pose.

    Our choice: as many as keep a search below some seconds.
    """

    most: int = 80  # postures that may fail at the other waypoints
    of_option: int = 4  # the same for one option
    of_torso: int = 2  # postures for one option with one torso
    first: int = 4  # postures that are glanced at together at first: one of these often does
    more: int = 4  # so many times as many each further time [ratio]


_GLANCE = GlanceParameters()


@dataclass(frozen=True, eq=False)
class Glance:
    """A glance at postures with which the hand is at the key waypoints of options.

    Attributes:
        site: Where to work.
        base: (3,) base pose.
        behind: What is in the way where the arm takes its posture, in that base frame.
        arms: Postures (7,) of the arms before.
        torsos: (m, 4).
        options: The options in question.
        goals: T_base_tcp (K, 4, 4) of the waypoints of each.
        keys: The waypoint of each option that the postures are of.
        t: (n,) torso of each posture.
        g: (n,) its option.
        q: (n, 7) the arm.
    """

    site: Site
    base: Array
    behind: Obstacles
    arms: Mapping[Side, Array]
    torsos: Array
    options: Sequence[Option]
    goals: Sequence[Array]
    keys: Sequence[int]
    t: NDArray[np.intp]
    g: NDArray[np.intp]
    q: Array

    def passed(self, rows: NDArray[np.intp]) -> Iterator[int]:
        """Those of `rows` (m,) with which the hand gets to the other waypoints, too, until too many are refused.

        In their order, and the same ones as if they were looked at one by one.
        """
        clear: dict[int, bool] = {}
        seen, refused = Counter[tuple[int, int]](), Counter[int]()
        together = _GLANCE.first
        for at, row in enumerate(rows.tolist()):
            if refused.total() >= _GLANCE.most:
                return
            if self._skipped(row, seen, refused):
                continue
            if row not in clear:
                some = self._batch(rows[at:].tolist(), seen.copy(), refused.copy(), together)
                clear.update(zip(some, self._clear(np.array(some)).tolist(), strict=True))
                together *= _GLANCE.more
            self._note(row, seen, Counter() if clear[row] else refused)
            if clear[row]:
                yield row

    def _batch(self, rows: list[int], seen: Counter[tuple[int, int]], refused: Counter[int], most: int) -> list[int]:
        """The first of `rows` that are looked at, if each is refused; so many at the most."""
        out: list[int] = []
        for row in rows:
            if len(out) < most and not self._skipped(row, seen, refused):
                self._note(row, seen, refused)
                out.append(row)
        return out

    def _skipped(self, row: int, seen: Counter[tuple[int, int]], refused: Counter[int]) -> bool:
        torso, option = int(self.t[row]), int(self.g[row])
        return seen[torso, option] >= _GLANCE.of_torso or refused[option] >= _GLANCE.of_option

    def _note(self, row: int, seen: Counter[tuple[int, int]], refused: Counter[int]) -> None:
        seen[int(self.t[row]), int(self.g[row])] += 1
        refused[int(self.g[row])] += 1

    def _clear(self, rows: NDArray[np.intp]) -> NDArray[np.bool_]:
        """(m,) bool: postures with which the arm reaches, and is clear at, each other waypoint of its option."""
        out = np.ones(len(rows), bool)
        ways = [[k for k in range(len(self.goals[g])) if k != self.keys[g]] for g in self.g[rows]]
        for turn in range(max(map(len, ways))):
            asked = np.flatnonzero([good and turn < len(way) for good, way in zip(out, ways, strict=True)])
            if not len(asked):
                break
            there = rows[asked]
            waypoints = [ways[i][turn] for i in asked]
            goals = np.stack([self.goals[g][k] for g, k in zip(self.g[there], waypoints, strict=True)])
            targets = matmul(self._from_chest[self.t[there]], goals)
            found, q = self.site.motion.robot.nearest_postures(targets, self.site.side, self.q[there])
            out[asked[~found]] = False
            alike = defaultdict[tuple[int, bool, int], list[int]](list)  # by torso, and what is asked of it there
            for j in np.flatnonzero(found).tolist():
                option = self.options[self.g[there[j]]]
                load = id(option.load) if waypoints[j] > option.contact else 0
                alike[int(self.t[there[j]]), waypoints[j] < option.contact, load].append(j)
            for (t, *_), js in alike.items():
                option = self.options[self.g[there[js[0]]]]
                out[asked[js]] = free(self.site, self.body(t), self.base, option, waypoints[js[0]], q[js])
        return out

    @cached_property
    def _from_chest(self) -> Array:
        """(m, 4, 4) T_chest_base of each torso."""
        return kin.inverse(self.site.motion.robot.chest(self.torsos))

    def body(self, t: int) -> Body:
        """The robot with torso `t` where the arm takes its posture."""
        return self.site.body(self.torsos[t], self.behind, self.arms)


def free(site: Site, body: Body, base: Array, option: Option, k: int, q: Array) -> NDArray[np.bool_]:
    """(n,) bool: postures q (n, 7) that are clear at waypoint `k` of an option."""
    if k < option.contact:
        return body.amid(site.around(base, touched=True)).free(site.side, q, MARGIN_M)
    held = after(site, body, option) if k > option.contact else bare(site, body)
    return body.amid(site.around(base, touched=False), held).free(site.side, q, -TOUCH_M, grasping=True)


def bare(site: Site, body: Body) -> dict[Side, Load]:
    """What the other hand holds."""
    return {s: load for s, load in body.held.items() if s != site.side}


def after(site: Site, body: Body, option: Option) -> dict[Side, Load]:
    """What the hands hold after the contact."""
    held = bare(site, body)
    return held if option.load is None else {**held, site.side: option.load}
