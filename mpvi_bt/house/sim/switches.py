"""Switches of things: a fingertip that stays on one for a moment turns the thing on or off, as in OmniGibson.

Some things are on only while they are closed: no finger turns them on while they are open, and opening turns them off.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import sapien

from mpvi_bt.finding.perception.detector import SWITCH
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.linear_algebra import matmul, norm
from mpvi_bt.ground.geometry.solids import Array, Solid
from mpvi_bt.house.sim.builder import Thing, show
from mpvi_bt.house.states.relations import OPEN_FRACTION
from mpvi_bt.house.things.description import Color, Part, Switch

SWITCH_M = 0.03  # a fingertip this near to a switch is on it
PRESSED_STEPS = 5  # it has to stay so many control steps, and then to leave, before the switch turns again
_OFF: Color = (0.85, 0.12, 0.1)
_ON: Color = (0.2, 0.95, 0.3)
_THICK_M = 0.004
_HAND_M = 0.5  # no finger is longer, so that a hand farther from a switch has none on it


@dataclass(eq=False)
class _Place:
    """One switch of one thing.

    Attributes:
        thing, body: What it is on.
        T_body: (4, 4) the switch to the body, z pointing out of the thing.
        closed_only: As of `Switch`.
        fixed: (4, 4) the switch to the world where it never moves, else None.
        lights: What cameras see of it while it is off and while it is on; empty without rendering.
        pressed: Control steps that a fingertip has been on it.
    """

    thing: Thing
    body: str
    T_body: Array
    closed_only: bool
    fixed: Array | None = None
    lights: Sequence[sapien.Entity] = ()
    pressed: int = 0

    def T_world(self) -> Array:  # noqa: N802
        """(4, 4) the switch to the world, z pointing out of the thing."""
        return matmul(self.thing.T_world_body(self.body), self.T_body) if self.fixed is None else self.fixed

    def kept_off(self) -> bool:
        """Whether it cannot be on now, because its thing is open."""
        return self.closed_only and any(f > OPEN_FRACTION for f in self.thing.joint_fractions())


class Switches:
    """Every switch of a scene, and what is on."""

    def __init__(self, scene: sapien.Scene, things: Mapping[str, Thing], visible: bool) -> None:
        """Find the switches of `things`; `visible` ones are small disks, red while off and green while on."""
        self._on = {name: False for name, thing in things.items() if any(b.switches for b in thing.description.bodies)}
        self._places = [
            _place(thing, body.name, switch, _lights(scene, name, switch) if visible else ())
            for name, thing in things.items()
            for body in thing.description.bodies
            for switch in body.switches
        ]

    @property
    def labels(self) -> dict[int, str]:
        """Scene ids of what cameras see of switches, to "<thing>.switch"."""
        return {e.per_scene_id: p.thing.name + SWITCH for p in self._places for e in p.lights}

    @property
    def on(self) -> dict[str, bool]:
        """Whether each thing that has a switch is on; a copy."""
        return dict(self._on)

    def turn(self, on: Mapping[str, bool]) -> None:
        """Turn things on or off at once, whoever does it; those that have no switch are passed over."""
        self._on.update({name: bool(value) for name, value in on.items() if name in self._on})
        for place in self._places:
            place.pressed = 0

    def of(self, name: str) -> list[Array]:
        """T_world_switch (4, 4) of each switch of a thing, z pointing out of it."""
        return [place.T_world() for place in self._places if place.thing.name == name]

    def step(self, hands: Array, fingertips: Callable[[], Array]) -> None:
        """One control step.

        Args:
            hands: (n, 3) where the links are that fingers are fixed to, in the world [m].
            fingertips: Tells where the fingertips (n, 3) are; asked only if a hand is near a switch.
        """
        if not self._places:
            return
        centers = np.array([place.T_world()[:3, 3] for place in self._places])
        nearest = _squared(hands, centers)
        if nearest.min() < _HAND_M**2:
            nearest = _squared(fingertips(), centers)
        for place, squared in zip(self._places, nearest.tolist(), strict=True):
            name = place.thing.name
            place.pressed = place.pressed + 1 if squared < SWITCH_M**2 else 0
            if (place.pressed or self._on[name]) and place.kept_off():
                place.pressed, self._on[name] = 0, False
            if place.pressed == PRESSED_STEPS:
                self._on[name] = not self._on[name]

    def show(self) -> None:
        """Bring what cameras see to where the switches are."""
        for place in self._places:
            lit, T = self._on[place.thing.name], place.T_world()
            away = T.copy()
            away[2, 3] = -9.0  # below the floor, out of every picture
            for light, shown in zip(place.lights, (not lit, lit), strict=bool(place.lights)):
                light.set_pose(sapien.Pose(T if shown else away))


def _squared(points: Array, centers: Array) -> Array:
    """(m,) the squared distance of each center (m, 3) from the nearest point (n, 3)."""
    return np.asarray(((points[:, None] - centers) ** 2).sum(-1).min(0))


def _place(thing: Thing, body: str, switch: Switch, lights: Sequence[sapien.Entity]) -> _Place:
    """A place, its frame worked out beforehand where the body stands still: that of every fixture but its doors."""
    T_body = _frame(switch)
    still = not thing.movable and body == thing.description.root.name
    fixed = matmul(thing.T_world_body(body), T_body) if still else None
    return _Place(thing, body, T_body, switch.closed_only, fixed, lights)


def _lights(scene: sapien.Scene, name: str, switch: Switch) -> tuple[sapien.Entity, ...]:
    entities = []
    for color in (_OFF, _ON):
        entity = sapien.Entity()
        entity.name = name + SWITCH
        disk = Solid("cylinder", np.array([switch.radius_m, switch.radius_m, _THICK_M / 2]))
        show(entity, [Part(disk, color, collides=False)])
        scene.add_entity(entity)
        entities.append(entity)
    return tuple(entities)


def _frame(switch: Switch) -> Array:
    z = switch.outward
    x = np.cross([0.0, 0.0, 1.0] if abs(z[2]) < 0.9 else [0.0, 1.0, 0.0], z)
    x /= norm(x)
    return kin.transform(np.stack([x, np.cross(z, x), z], axis=1), switch.center)
