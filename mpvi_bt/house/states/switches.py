"""Switches of things: a fingertip that stays on one for a moment turns the thing on or off, as in OmniGibson.

Some things are on only while they are closed: no finger turns them on while they are open, and opening turns them off.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.house.states.in_world import SwitchLike, ThingLike
from mpvi_bt.house.states.relations import OPEN_FRACTION

SWITCH_M = 0.03  # a fingertip this near to a switch is on it
PRESSED_STEPS = 5  # it has to stay so many control steps, and then to leave, before the switch turns again
_HAND_M = 0.5  # no finger is longer, so that a hand farther from a switch has none on it


@dataclass(eq=False)
class SwitchPlace:
    """One switch of one thing.

    Attributes:
        thing, body: What it is on.
        switch: It, in the frame of the body.
        T_body: (4, 4) the switch to the body, z pointing out of the thing.
        fixed: (4, 4) the switch to the world where it never moves, else None.
        pressed: Control steps that a fingertip has been on it.
    """

    thing: ThingLike
    body: str
    switch: SwitchLike
    T_body: Array
    fixed: Array | None = None
    pressed: int = 0

    def T_world(self) -> Array:  # noqa: N802
        """(4, 4) the switch to the world, z pointing out of the thing."""
        return matmul(self.thing.T_world_body(self.body), self.T_body) if self.fixed is None else self.fixed

    def kept_off(self) -> bool:
        """Whether it cannot be on now, because its thing is open."""
        return self.switch.closed_only and any(f > OPEN_FRACTION for f in self.thing.joint_fractions())


class Switches:
    """Every switch of a world, and what is on.

    Attributes:
        places: Each switch, and where it is.
    """

    def __init__(self, things: Mapping[str, ThingLike]) -> None:
        """Find the switches of `things`; all are off."""
        self._on = {name: False for name, thing in things.items() if any(b.switches for b in thing.description.bodies)}
        self.places = [
            _place(thing, body.name, switch)
            for thing in things.values()
            for body in thing.description.bodies
            for switch in body.switches
        ]

    @property
    def on(self) -> dict[str, bool]:
        """Whether each thing that has a switch is on; a copy."""
        return dict(self._on)

    def turn(self, on: Mapping[str, bool]) -> None:
        """Turn things on or off at once, whoever does it; those that have no switch are passed over."""
        self._on.update({name: bool(value) for name, value in on.items() if name in self._on})
        for place in self.places:
            place.pressed = 0

    def of(self, name: str) -> list[Array]:
        """T_world_switch (4, 4) of each switch of a thing, z pointing out of it."""
        return [place.T_world() for place in self.places if place.thing.name == name]

    def step(self, hands: Array, fingertips: Callable[[], Array]) -> None:
        """One control step.

        Args:
            hands: (n, 3) where the links are that fingers are fixed to, in the world [m].
            fingertips: Tells where the fingertips (n, 3) are; asked only if a hand is near a switch.
        """
        if not self.places:
            return
        centers = np.array([place.T_world()[:3, 3] for place in self.places])
        nearest = _squared(hands, centers)
        if nearest.min() < _HAND_M**2:
            nearest = _squared(fingertips(), centers)
        for place, squared in zip(self.places, nearest.tolist(), strict=True):
            name = place.thing.name
            place.pressed = place.pressed + 1 if squared < SWITCH_M**2 else 0
            if (place.pressed or self._on[name]) and place.kept_off():
                place.pressed, self._on[name] = 0, False
            if place.pressed == PRESSED_STEPS:
                self._on[name] = not self._on[name]


def _squared(points: Array, centers: Array) -> Array:
    """(m,) the squared distance of each center (m, 3) from the nearest point (n, 3); infinite if there is none."""
    return np.asarray(((points[:, None] - centers) ** 2).sum(-1).min(0, initial=np.inf))


def _place(thing: ThingLike, body: str, switch: SwitchLike) -> SwitchPlace:
    """A switch's place. Its frame is computed once if the body stands still, as on all fixtures but their doors."""
    T_body = _frame(switch)
    still = not thing.movable and body == thing.description.root.name
    fixed = matmul(thing.T_world_body(body), T_body) if still else None
    return SwitchPlace(thing, body, switch, T_body, fixed)


def _frame(switch: SwitchLike) -> Array:
    z = switch.outward
    x = np.cross([0.0, 0.0, 1.0] if abs(z[2]) < 0.9 else [0.0, 1.0, 0.0], z)
    x /= norm(x)
    return kin.transform(np.stack([x, np.cross(z, x), z], axis=1), switch.center)
