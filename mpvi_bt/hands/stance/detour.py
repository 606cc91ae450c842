"""The way of the base around what stands between here and there, by places on a grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.hands.stance.base_search import KNOWN_M, BaseSearch


@dataclass(frozen=True)
class DetourParameters:
    """The grid of intermediate places.

    Our choice: no finer than the error of the base.
    """

    step_m: float = 0.12  # distance between places [m]
    beside_m: float = 0.2  # distance from the last place to the goal [m]


_DETOUR = DetourParameters()


class Detours:
    """Ways from where the base is to what is known from there, its yaw unchanged up to the last leg.

    Our choice: a stance is searched for where the base comes straight or by one place on the way. This is for where it
    comes by more, such as the far side of a table with baskets around it.
    """

    def __init__(self, site: BaseSearch) -> None:
        """Find the places that the base may stand at, and the ways to them."""
        self._site, here = site, site.motion.felt.base_pose
        steps = np.arange(-KNOWN_M, KNOWN_M + 1e-9, _DETOUR.step_m)
        grid = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
        places = here + np.column_stack([grid, np.zeros(len(grid))])
        self._places = np.vstack([here, places[site.stands(places)]])  # where it stands it may be in touch with things
        tree = KDTree(self._places[:, :2])
        graph = tree.sparse_distance_matrix(tree, 1.5 * _DETOUR.step_m, output_type="coo_matrix").tocsr()
        self._length, self._before = dijkstra(graph, indices=0, return_predecessors=True)

    def way(self, goal: Array) -> list[Array] | None:
        """Base poses (3,) to drive to `goal` (3,) by, few long legs rather than many; None if there is no way."""
        last = norm(self._places[:, :2] - goal[:2], axis=1)
        k = int(np.where(last < _DETOUR.beside_m, self._length + last, np.inf).argmin())
        if last[k] >= _DETOUR.beside_m or not np.isfinite(self._length[k]):
            return None
        left = [goal]
        while k > 0:
            left.append(self._places[k])
            k = int(self._before[k])
        legs = [self._places[0]]
        while left:  # the goal first: each leg leads as far on as it can
            far = next((j for j, place in enumerate(left) if self._site.drivable(legs[-1], place)), None)
            if far is None:
                return None
            legs.append(left[far])
            left = left[:far]
        return legs[1:]
