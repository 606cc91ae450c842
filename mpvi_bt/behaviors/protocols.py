"""What behaviors ask of the parts that they drive: a navigator, a policy, a checker, and a clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Protocol

from mpvi_bt.robot.protocol import CameraImage, Side
from mpvi_bt.robot.solids import Array


class Clock(Protocol):
    """Simulated time. Everything that waits, waits in it."""

    @property
    def time_s(self) -> float:
        """Seconds since the episode began."""
        ...

    @property
    def steps(self) -> int:
        """Control steps since the episode began."""
        ...


class Progress(Enum):
    """How a module's work stands."""

    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"


@dataclass(frozen=True)
class Report:
    """What a module says after each step.

    Attributes:
        progress: How its work stands.
        reason: Stable code once it has failed, such as "no_path"; "" before.
        feedback: One short line for a person, without numbers that change every step.
    """

    progress: Progress
    reason: str = ""
    feedback: str = ""


class Navigator(Protocol):
    """Drives the base to a named target (Paper, Navigation)."""

    def start(self, target: str, room: str | None) -> None:
        """Begin driving to `target`, a phrase such as "trash can" or "kitchen"; `room` narrows the search."""
        ...

    def step(self) -> Report:
        """Write the robot's command for one step and say how the drive stands."""
        ...

    def stop(self) -> None:
        """Let the base stand still. Safe to call at any time, twice too."""
        ...


class Memory(Protocol):
    """Learns while a run lasts, such as where things are; a run that is stopped and goes on still knows it."""

    def save(self) -> dict[str, Any]:
        """What was learned so far, as JSON values."""
        ...

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on with that. Raises KeyError, TypeError or ValueError if it is not as `save` writes it."""
        ...


class Policy(Protocol):
    """A manipulation policy: observation in, action chunk out (the VLA's place in the paper).

    It may have two things besides: `note`, a str that says on one line what it is doing or why it is stuck, without
    numbers that change every step; and `close()`, called once when nothing more will be asked of it.
    """

    @property
    def name(self) -> str:
        """As given on the command line."""
        ...

    @property
    def cameras(self) -> tuple[str, ...]:
        """The cameras that it wants in the next observation, of "head", "left", "right"; read before every `infer`.

        A picture that nobody asks for costs nothing, so a policy may ask for one only when it looks. It must not mind
        more pictures than it asked for.
        """
        ...

    def reset(self) -> None:
        """Forget everything: called at each handoff and whenever the prompt changes. Raises PolicyError, as `infer`."""
        ...

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """The next actions, (H, 23), H >= 1, one a control step. They may move the base, too.

        Args:
            observation: "prompt": str; "proprioception": Proprioception; "images": Mapping camera -> CameraImage.

        Raises:
            PolicyError: What runs the policy, such as a server, failed; the episode ends and is not the policy's.
        """
        ...


@dataclass(frozen=True)
class Judgement:
    """A checker's answer: is the criterion met, and what made it think so."""

    complete: bool
    reason: str


class Checker(Protocol):
    """Decides whether a completion criterion holds (the VLM's place in the paper).

    Attributes:
        name: As given on the command line.
        needs_image: Whether `check` must be handed a picture.
    """

    name: str
    needs_image: bool

    def check(self, criterion: str, image: CameraImage | None) -> Judgement:
        """Whether `criterion`, a state such as "the trash can is held in a gripper", is met.

        Anything that it cannot decide is a no.
        """
        ...


@dataclass(frozen=True)
class TriggerEvent:
    """Proprioception says that something just happened (Paper, Completion Checker).

    Attributes:
        kind: "grasp", "release" or "rest".
        side: The hand that it happened to, whose camera may show it.
    """

    kind: str
    side: Side | None


class Triggers(Protocol):
    """Watches proprioception for the end of a manipulation primitive."""

    def reset(self, kinds: tuple[str, ...] | None = None) -> None:
        """Begin anew; only events of `kinds` will fire (None: grasps and releases, which may end any primitive)."""
        ...

    def update(self) -> TriggerEvent | None:
        """Read proprioception once a step; the event that fires now, if any."""
        ...
