"""Relations of things as they stand now, with the meaning that OmniGibson gives them (bddl's semantics table).

Distances are in meters, in the world frame, z up. Rays see through things ("all hits"), as OmniGibson's do.
"""

from __future__ import annotations

import numpy as np

from mpvi_bt.ground.geometry.linear_algebra import norm
from mpvi_bt.ground.geometry.next_to import NEXT_TO_GAP, RAY_M, beside
from mpvi_bt.ground.geometry.rays import crosses, interval, within
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.house.states.world_state import WorldState, aabb

OPEN_FRACTION = 0.05  # of a joint's range

UP, DOWN = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])


def inside(state: WorldState, a: str, b: str) -> bool:
    """The middle of a's bounding box is in b's bounding box and in one of b's container volumes."""
    middle, box = aabb(state, a).mean(0), aabb(state, b)
    if not np.all((box[0] <= middle) & (middle <= box[1])):
        return False
    return any(within(volume, middle) for volume in state.volumes(b))


def touching(state: WorldState, a: str, b: str) -> bool:
    """Physics reports a contact between the two."""
    return state.touching(a, b)


def ontop(state: WorldState, a: str, b: str) -> bool:
    """They touch, and b is met straight down from a's surface but not straight up from it."""
    return resting_on(state, a, b) and not _meets(state, a, b, UP)


def resting_on(state: WorldState, a: str, b: str) -> bool:
    """They touch, and b is met straight down from a's surface.

    Our choice of what a sentence means by "on": unlike `ontop`, so of the lower board of a rack that has another above.
    No literal of a problem is judged by it.
    """
    return state.touching(a, b) and _meets(state, a, b, DOWN)


def under(state: WorldState, a: str, b: str) -> bool:
    """Straight up from a's surface b is met, straight down it is not; and straight up from b, a is not."""
    return _meets(state, a, b, UP) and not _meets(state, a, b, DOWN) and not _meets(state, b, a, UP)


def nextto(state: WorldState, a: str, b: str) -> bool:
    """Their bounding boxes are close for their size, and a horizontal ray from the middle of either meets the other."""
    box_a, box_b = aabb(state, a), aabb(state, b)
    gap = np.maximum(0.0, np.maximum(box_a[0], box_b[0]) - np.minimum(box_a[1], box_b[1]))
    if norm(gap) > NEXT_TO_GAP * np.mean(np.ptp(box_a, axis=0) + np.ptp(box_b, axis=0)):
        return False
    return beside(box_a.mean(0), state.solids(b)) or beside(box_b.mean(0), state.solids(a))


def open_(state: WorldState, a: str) -> bool:
    """Any of its joints is past 5 % of its range."""
    return any(fraction > OPEN_FRACTION for fraction in state.joint_fractions(a))


def covered(state: WorldState, a: str, b: str) -> bool:
    """There is at least one mark of a substance on it, or one of its grains touches it."""
    kind = kind_of(b)
    return state.covered(a, kind) or any(state.touching(a, grain) for grain in state.grains(kind))


def kind_of(name: str) -> str:
    """The synset of a BDDL name: what a substance's instance stands for."""
    return name.rpartition("_")[0]


def _meets(state: WorldState, a: str, b: str, direction: Array) -> bool:
    """Whether a vertical ray that leaves a's surface, over or under the middle of its bounding box, meets b."""
    middle = aabb(state, a).mean(0)
    spans = [span for solid in state.solids(a) if (span := interval(solid, middle, direction)) is not None]
    outermost = max((span[1] for span in spans), default=0.0)  # where it misses a itself, as in a ring: the middle
    return crosses(state.solids(b), middle + outermost * direction, direction, RAY_M)
