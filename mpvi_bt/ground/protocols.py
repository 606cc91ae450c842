"""Protocols of the parts that behaviors use: navigator, policy, checker, triggers and clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Protocol

from mpvi_bt.ground.cost import Cost
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, CameraImage, Side


class Clock(Protocol):
    """Simulated time, in which everything waits."""

    @property
    def time_s(self) -> float:
        """Seconds since the episode began."""
        ...

    @property
    def steps(self) -> int:
        """Control steps since the episode began."""
        ...


class StepClock:
    """A clock that counts control steps.

    Attributes:
        steps: Control steps since the episode began.
    """

    steps: int = 0

    @property
    def time_s(self) -> float:
        """Seconds since the episode began."""
        return self.steps / CONTROL_HZ


class Progress(Enum):
    """Progress of a module's work."""

    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"


@dataclass(frozen=True)
class Report:
    """A module's report after each step.

    Attributes:
        progress: Of its work.
        reason: Stable code after a failure, such as "no_path"; "" before.
        feedback: One short line for a person, without numbers that change every step.
    """

    progress: Progress
    reason: str = ""
    feedback: str = ""


class Navigator(Protocol):
    """Drives the base to a named target (Paper, Navigation).

    Optional: `leave()`, called right before `start`: where the base stands now is no place to stop this time.
    """

    def start(self, target: str, room: str | None) -> None:
        """Begin driving to `target`, a phrase such as "trash can" or "kitchen"; `room` narrows the search."""
        ...

    def step(self) -> Report:
        """Write the robot's command for one step and report the progress of the drive."""
        ...

    def stop(self) -> None:
        """Let the base stand still. Safe to call at any time, twice too."""
        ...


class Memory(Protocol):
    """State learned during a run, such as places of objects; a resumed run keeps it."""

    def save(self) -> dict[str, Any]:
        """The learned state, as JSON values."""
        ...

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Restore that state. Raises KeyError, TypeError or ValueError if it is not as `save` writes it."""
        ...


NO_SKILL = "no_skill"  # how the note of a policy begins that has given up what it never learned


class Policy(Protocol):
    """A manipulation policy: observation in, action chunk out (the VLA's place in the paper).

    Optional: `note`, a str, one line on what it is doing or why it is stuck, without numbers that change every step;
    `gave_up`, a bool: it has given up this prompt, which a policy behind it may do if the note begins with `NO_SKILL`;
    `ended`, a bool: it thinks that the prompt is done, or has given up; `progress`, a float, 0 to 1: how far along it
    takes itself to be, or None; `rate_hz`, its rows a second, or `dataset`, a folder of LeRobot's or of a recorded
    demonstration that says it; `actions`, "absolute", "delta" or "velocity", what joints in its rows are; and
    `close()`, called once at the end.
    """

    @property
    def name(self) -> str:
        """As given on the command line."""
        ...

    @property
    def cameras(self) -> tuple[str, ...]:
        """The cameras needed in the next observation, of "head", "left", "right"; read before every `infer`.

        Pictures are rendered on demand, so ask for one only when it is used. The observation may have more.
        """
        ...

    def reset(self) -> None:
        """Forget everything: called at each handoff and whenever the prompt changes. Raises PolicyError, as `infer`."""
        ...

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """The next actions, (H, 23), H >= 1, one a control step, or at its own rate. They may move the base, too.

        Args:
            observation: "prompt": str; "proprioception": Proprioception; "images": Mapping camera -> CameraImage;
                "command": (23,) what the robot was told last.

        Raises:
            PolicyError: The policy's backend, such as a server, failed; the episode ends and does not count for the
                policy.
        """
        ...


@dataclass(frozen=True)
class Judgement:
    """A checker's answer, with its reason.

    Attributes:
        complete: The answer.
        reason: One line.
        latency_s: Time that the answer took, and takes in simulated time; 0: it arrives in the same tick.
        fault: Code, such as "bad_answer" or "refused", if there is no answer: it is counted as neither yes nor no.
        cost: Of a language model's answer, or None.
    """

    complete: bool
    reason: str
    latency_s: float = 0.0
    fault: str = ""
    cost: Cost | None = None


class Checker(Protocol):
    """Decides whether a completion criterion holds (the VLM's place in the paper).

    Optional: `remote`, a bool: True if `check` waits for another process. Such a checker is asked in a thread while the
    control loop goes on; any other is asked in the loop.

    Attributes:
        name: As given on the command line.
        needs_image: Whether `check` needs a picture.
    """

    name: str
    needs_image: bool

    def check(self, criterion: str, image: CameraImage | None) -> Judgement:
        """Whether `criterion`, a state such as "the trash can is held in a gripper", is met.

        An undecidable criterion is a no.

        Raises:
            ModelError: A language model cannot be asked at all, as without a key; the episode ends.
        """
        ...


@dataclass(frozen=True)
class TriggerEvent:
    """An event in proprioception (Paper, Completion Checker).

    Attributes:
        kind: "grasp", "release", "stop", "rest", "arrival", "idle" or "periodic".
        side: The hand concerned, whose camera may show the result; None for the whole body.
    """

    kind: str
    side: Side | None


class Triggers(Protocol):
    """Watches proprioception for the end of a manipulation primitive.

    Those that notice a release before they report it may have `released`: the hand that has let go in this step.
    """

    def reset(self, kinds: Mapping[str, float | None] | None = None) -> None:
        """Begin anew.

        Args:
            kinds: Events that may fire, each with the least simulated time after the previous event of the same hand
                (None: the default). None: all events that may end an unknown primitive.
        """
        ...

    def update(self) -> TriggerEvent | None:
        """Read proprioception once a step; the event that fires now, if any."""
        ...
