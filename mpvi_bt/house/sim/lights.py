"""What cameras see of switches: small disks, red while the thing is off and green while it is on."""

from __future__ import annotations

import numpy as np
import sapien

from mpvi_bt.finding.perception.detector import SWITCH
from mpvi_bt.ground.geometry.solids import Solid
from mpvi_bt.house.sim.builder import show
from mpvi_bt.house.states.switches import Switches, SwitchPlace
from mpvi_bt.house.things.description import Color, Part

_OFF: Color = (0.85, 0.12, 0.1)
_ON: Color = (0.2, 0.95, 0.3)
_THICK_M = 0.004


class Lights:
    """The disks of a scene, two at each switch, of which one is shown."""

    def __init__(self, scene: sapien.Scene, switches: Switches) -> None:
        """Make the disks of all switches; `show` puts them there."""
        self._switches = switches
        self._pairs = [(place, tuple(_disk(scene, place, color) for color in (_OFF, _ON))) for place in switches.places]

    @property
    def labels(self) -> dict[int, str]:
        """Scene ids of disks, to "<thing>.switch"."""
        return {disk.per_scene_id: place.thing.name + SWITCH for place, disks in self._pairs for disk in disks}

    def show(self) -> None:
        """Draw the lights of all switches, at their current places."""
        on = self._switches.on
        for place, disks in self._pairs:
            lit, T = on[place.thing.name], place.T_world()
            away = T.copy()
            away[2, 3] = -9.0  # below the floor, out of every picture
            for disk, shown in zip(disks, (not lit, lit), strict=True):
                disk.set_pose(sapien.Pose(T if shown else away))


def _disk(scene: sapien.Scene, place: SwitchPlace, color: Color) -> sapien.Entity:
    entity = sapien.Entity()
    entity.name = place.thing.name + SWITCH
    radius_m = place.switch.radius_m
    show(entity, [Part(Solid("cylinder", np.array([radius_m, radius_m, _THICK_M / 2])), color, collides=False)])
    scene.add_entity(entity)
    return entity
