"""Contents of hands and of containers, from places and contacts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import sapien

from mpvi_bt.ground.geometry.rays import distance
from mpvi_bt.ground.geometry.solids import Array, Solid, bounds
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.ground.robot.squeeze import squeezes
from mpvi_bt.house.sim.body import SimBody
from mpvi_bt.house.sim.builder import Thing

TOUCHING_M = 2e-3  # physics reports contacts before bodies meet; from farther off nothing is touched
_HELD_M = 0.012  # a thing this near the line between the pads of a hand that closed on something is in that hand
_PRESSED_M = 0.04  # likewise for a thing between two hands


class Holding:
    """What of some movable things is held, as they and the robot stand now."""

    def __init__(
        self, scene: sapien.Scene, robot: SimBody, objects: Mapping[str, Thing], things: Mapping[str, Thing]
    ) -> None:
        """Look at a scene.

        Args:
            scene: Whose contacts are looked at.
            robot: Whose hands hold.
            objects: What can be held, by name.
            things: What can have it inside, by name: all there is.
        """
        self._scene, self._robot, self._objects, self._things = scene, robot, objects, things

    def in_hand(self, side: Side) -> str | None:
        """The thing between the fingers of one hand: nearest to the line between the pads of a hand that closed on
        something, so that a cup, which has nothing in its middle, is held, too.
        """
        felt = self._robot.proprioception()
        if not felt.holds(side):
            return None
        T = self._robot.hand_pose_world(side)
        half = felt.gripper_width[side] / 2
        points = [T[:3, 3] + y * T[:3, 1] for y in np.linspace(-half, half, 5)]
        gaps = dict[str, float]()
        for name, thing in self._objects.items():
            solids = [s for s in thing.solids() if _may_be_near(s, T[:3, 3], half + _HELD_M)]
            gaps[name] = min((distance(s, p) for s in solids for p in points), default=np.inf)
        near = sorted((name for name in gaps if gaps[name] < _HELD_M), key=gaps.__getitem__)
        if len(near) > 1:  # what lies in a cup may be nearer to the fingers than the cup is that they hold
            contents = {inner for name in near for inner in self.within(name)}
            near = [name for name in near if name not in contents] or near
        return near[0] if near else None

    def between(self) -> str | None:
        """The thing pressed between both hands: the one that is nearest to both of them."""
        if not squeezes(self._robot.proprioception()):
            return None
        hands = [self._robot.hand_pose_world(side)[:3, 3] for side in SIDES]
        gaps = {n: max(min(distance(s, p) for s in t.solids()) for p in hands) for n, t in self._objects.items()}
        nearest = min(gaps, key=gaps.__getitem__, default=None)
        return nearest if nearest is not None and gaps[nearest] < _PRESSED_M else None

    def pinched(self, side: Side) -> list[str]:
        """The things that two fingers of one hand touch, by the contacts of the last physics step."""
        fingers = [self._robot.links[name].entity for name in self._robot.physics.finger_links[side]]
        touched: list[set[str]] = [set() for _ in fingers]
        for contact in self._scene.get_contacts():
            a, b = (body.entity for body in contact.bodies)
            for k, finger in enumerate(fingers):
                if finger in (a, b) and any(p.separation < TOUCHING_M for p in contact.points):
                    touched[k].add((b if finger == a else a).name)
        return [name for name in self._objects if sum(name in names for names in touched) > 1]

    def within(self, name: str) -> Sequence[str]:
        """The things whose middle lies in the container volumes of a thing."""
        volumes, others = self._things[name].volumes(), (n for n in self._objects if n != name)
        return [n for n in others if any(distance(v, self._middle(n)) <= 0 for v in volumes)]

    def _middle(self, name: str) -> Array:
        return np.asarray(bounds(self._things[name].solids()).mean(0))


def _may_be_near(solid: Solid, p: Array, reach_m: float) -> bool:
    """Whether the ball about a solid comes so near to a point (3,); most are told apart by this, and cheaply."""
    return math.dist(solid.T[:3, 3], p) < math.hypot(*solid.half_m) + reach_m
