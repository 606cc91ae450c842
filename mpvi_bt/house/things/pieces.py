"""Single solids as files describe them, of which compounds are made."""

from __future__ import annotations

from typing import Literal

import numpy as np

from mpvi_bt.ground.geometry.solids import Solid
from mpvi_bt.ground.marked_yaml import Coordinate, Record
from mpvi_bt.house.things.description import Color, Handle, PartsOfBody, Switch
from mpvi_bt.house.things.dimensions import Rgb, Size


class Button(Record):
    """A switch.

    Attributes:
        at: The middle of its face [m].
        out: The way out of the thing there: a finger comes against it.
    """

    at: tuple[Coordinate, Coordinate, Coordinate]
    out: Literal["x", "-x", "y", "-y", "z", "-z"] = "z"

    @property
    def switch(self) -> Switch:
        """As bodies have it."""
        sign = -1.0 if self.out.startswith("-") else 1.0
        return Switch(np.array(self.at), sign * np.eye(3)["xyz".index(self.out[-1])])


class Piece(Record):
    """One solid.

    Attributes:
        kind: Its shape.
        at: Its middle [m]; the thing stands on z = 0.
        size_m: Along x, y and z; a cylinder has its diameter twice and its length along `axis`.
        axis: That a cylinder lies along.
        color: None for the thing's own.
        collides: False for what is only seen, such as a label.
        grip: Whether it is what a hand takes the thing by: it lies along x or y, and its sides are free.
        blade: Whether it cuts what it presses on.
    """

    kind: Literal["box", "cylinder", "sphere"]
    at: tuple[Coordinate, Coordinate, Coordinate]
    size_m: Size
    axis: Literal["x", "y", "z"] = "z"
    color: Rgb | None = None
    collides: bool = True
    grip: bool = False
    blade: bool = False

    def add_to(self, parts: PartsOfBody, color: Color) -> None:
        """Add it, in its own color or else this one."""
        paint = self.color or color
        if self.kind == "box":
            parts.box(self.at, self.size_m, paint, collides=self.collides)
        elif self.kind == "sphere":
            parts.sphere(self.at, self.size_m[0], paint, collides=self.collides)
        else:
            along = "xyz".index(self.axis)
            across, length = self.size_m[along - 1], self.size_m[along]
            parts.cylinder(self.at, across, length, paint, axis=self.axis, collides=self.collides)

    @property
    def solid(self) -> Solid:
        """The solid alone."""
        parts = PartsOfBody()
        self.add_to(parts, (0.0, 0.0, 0.0))
        return parts.items[0].solid

    @property
    def handle(self) -> Handle:
        """A handle that is taken from above."""
        long = int(np.argmax(self.size_m[:2]))
        return Handle(
            np.array(self.at), np.eye(3)[long], np.array([0.0, 0, 1]), self.size_m[long], self.size_m[1 - long]
        )
