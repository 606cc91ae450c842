"""What changes of states ask of the things in a world; `sim` implements it."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Protocol

from mpvi_bt.ground.geometry.solids import Array, Solid

Motion = Mapping[str, list[float]]  # how a thing stands and moves: a pose (xyz, wxyz), velocities, joints


class SwitchLike(Protocol):
    """A button that a fingertip can press, in the frame of a body."""

    @property
    def center(self) -> Array:
        """(3,) middle of its face [m]."""
        ...

    @property
    def outward(self) -> Array:
        """(3,) unit vector out of the thing."""
        ...

    @property
    def closed_only(self) -> bool:
        """Whether the thing is on only while it is closed."""
        ...

    @property
    def radius_m(self) -> float:
        """Of what is seen of it."""
        ...


class BodyLike(Protocol):
    """A body of a kind of things, in its own frame."""

    @property
    def name(self) -> str:
        """Unique in the thing."""
        ...

    @property
    def switches(self) -> tuple[SwitchLike, ...]:
        """What turns the thing on and off."""
        ...

    @property
    def blades(self) -> tuple[Solid, ...]:
        """Edges that cut."""
        ...

    @property
    def volumes(self) -> tuple[Solid, ...]:
        """Where it holds things."""
        ...


class FormLike(Protocol):
    """What a kind of things is made of."""

    @property
    def root(self) -> BodyLike:
        """The body that the others are joined to."""
        ...

    @property
    def bodies(self) -> tuple[BodyLike, ...]:
        """All of them, the root first."""
        ...

    @property
    def jointed(self) -> bool:
        """Whether anything in it moves."""
        ...

    def extent(self, T: Array | None = None, visible: bool = False) -> Array:
        """(2, 3) lowest and highest corner around it [m]; with `visible`, also around what does not collide."""
        ...


class ThingLike(Protocol):
    """One thing that is there, movable or fixed."""

    @property
    def name(self) -> str:
        """Unique in the world."""
        ...

    @property
    def description(self) -> FormLike:
        """What it is made of."""
        ...

    @property
    def movable(self) -> bool:
        """Whether it is a free body."""
        ...

    @property
    def sleeps(self) -> bool:
        """Whether physics passes it over, because it rests."""
        ...

    @property
    def origin(self) -> Array:
        """(3,) of its frame, in the world [m]."""
        ...

    def T_world_body(self, body: str | None = None) -> Array:  # noqa: N802
        """(4, 4) pose of a body, the root by default."""
        ...

    def solids(self) -> Sequence[Solid]:
        """What collides, in the world."""
        ...

    def volumes(self) -> Sequence[Solid]:
        """Where it holds things, in the world."""
        ...

    def joint_fractions(self) -> Sequence[float]:
        """Opening of each joint, 0 to 1."""
        ...

    def motion(self) -> Motion:
        """How it stands and moves."""
        ...


class Coming(Protocol):
    """The present things, and the things still to come."""

    @property
    def there(self) -> Mapping[str, ThingLike]:
        """Movable things by name, as they come and go."""
        ...

    def waits(self, kind: str) -> bool:
        """Whether one of a kind may still come to be."""
        ...

    def appear(self, kind: str, T: Array, motion: Motion) -> str | None:
        """Have the next of a kind stand at `T` (4, 4) and move like what it comes from; its name, or None."""
        ...

    def vanish(self, name: str) -> None:
        """Take a thing out of the world for good."""
        ...


class Touches(Protocol):
    """Where things touch, and how hard."""

    def __call__(self, name: str, others: Collection[str]) -> Iterator[tuple[str, Sequence[tuple[Array, Array]]]]:
        """Each contact of a thing with one of some others in the last step of physics.

        Returns:
            The other's name; of each point its place (3,) in the world [m] and its impulse (3,) [N s].
        """
        ...


class Springs(Protocol):
    """Ties between things."""

    def tie(self, child: str, parent: str, between: Array, linear: Array, angular: Array) -> None:
        """Tie a child to a parent.

        Args:
            child, parent: Names of things.
            between: (4, 4) of the child in the parent's frame, where the spring is slack.
            linear: (2,) stiffness [N/m] and damping [N s/m].
            angular: (2,) stiffness [N m/rad] and damping [N m s/rad].
        """
        ...

    def untie(self, child: str) -> None:
        """Undo the tie of a child."""
        ...
