"""Protocols of the parts that behaviors use: navigator, policy, checker, triggers and clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Protocol

from mpvi_bt.marked_yaml import Count
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

    It may have three things besides: `note`, a str that says on one line what it is doing or why it is stuck, without
    numbers that change every step; `gave_up`, a bool: it will do no more about this prompt; and `close()`, called once
    when nothing more will be asked of it.
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
class Cost:
    """What a language model's answer cost.

    Attributes:
        model: That gave it.
        tokens_in, tokens_out: Of the question and of the answer, as the model's server counts them.
        kept: It came from answers on file: nothing was spent.
    """

    model: str
    tokens_in: Count = 0
    tokens_out: Count = 0
    kept: bool = False


@dataclass(frozen=True)
class Judgement:
    """A checker's answer: is the criterion met, and what made it think so.

    Attributes:
        complete: The answer.
        reason: What made it think so, one line.
        latency_s: How long the answer took, or is to take in simulated time; 0: it is there in the same tick.
        fault: Code of what was wrong, where this is a no for want of an answer, such as "bad_answer" or "refused".
        cost: Of a language model's answer, or None.
    """

    complete: bool
    reason: str
    latency_s: float = 0.0
    fault: str = ""
    cost: Cost | None = None


class Checker(Protocol):
    """Decides whether a completion criterion holds (the VLM's place in the paper).

    It may have `remote` besides, a bool: True if `check` waits for something elsewhere. Such a checker is asked in a
    thread and the control loop goes on meanwhile; any other is asked in the loop.

    Attributes:
        name: As given on the command line.
        needs_image: Whether `check` must be handed a picture.
    """

    name: str
    needs_image: bool

    def check(self, criterion: str, image: CameraImage | None) -> Judgement:
        """Whether `criterion`, a state such as "the trash can is held in a gripper", is met.

        Anything that it cannot decide is a no.

        Raises:
            ModelError: A language model may not be asked at all, as without a key; the episode ends.
        """
        ...


@dataclass(frozen=True)
class TriggerEvent:
    """Proprioception says that something just happened (Paper, Completion Checker).

    Attributes:
        kind: "grasp", "release", "stop", "rest", "arrival", "idle" or "periodic".
        side: The hand that it happened to, whose camera may show it; None if it is no hand's.
    """

    kind: str
    side: Side | None


class Triggers(Protocol):
    """Watches proprioception for the end of a manipulation primitive."""

    def reset(self, kinds: Mapping[str, float | None] | None = None) -> None:
        """Begin anew.

        Args:
            kinds: Events that will fire, each with the least simulated time between it and the one before, of the same
                hand (None: as the triggers have it). None: all that may end a primitive that nobody has told us of.
        """
        ...

    def update(self) -> TriggerEvent | None:
        """Read proprioception once a step; the event that fires now, if any."""
        ...
