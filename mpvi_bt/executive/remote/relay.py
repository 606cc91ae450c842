"""A policy whose questions are answered by whoever runs the episode, in another thread: the loop, turned inside out.

The episode's thread asks, as it asks any policy, and waits. The other thread takes the question, as the message that a
server would be sent, and gives back the server's reply.
"""

from __future__ import annotations

import queue
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.executive.remote.connection import one_line
from mpvi_bt.executive.remote.dialect_settings import DialectSettings
from mpvi_bt.executive.remote.observation import Vocabulary
from mpvi_bt.executive.remote.openpi import cameras_of, question
from mpvi_bt.executive.remote.wire_mapping import actions_of
from mpvi_bt.ground.errors import PolicyError, UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.action_layout import ActionKind
from mpvi_bt.ground.robot.action_rows import check_rate, command_of
from mpvi_bt.ground.robot.protocol import Proprioception
from mpvi_bt.ground.robot.robots import layout_of


class Stopped(KeyboardInterrupt):
    """No more answers will come: the episode is to end as by Ctrl-C."""


class Relay:
    """Both ends of the conversation of one episode; the policy's end is a `mpvi_bt.ground.protocols.Policy`.

    Args:
        name: Of the policy.
        settings: What a message has in it, and how a reply is read.
        first: Cameras whose pictures are wanted when the policy begins anew; None: all that the settings map.

    Attributes:
        name: Of the policy.
        vocabulary: What labels of pictures are called; told where the whole observation is.
        cameras: Those that are wanted first, or that the last reply said it wants.
        note: What the last reply said that the server is doing; one line.
        gave_up: Whether it said that it will do no more about the prompt.
        rate_hz, rate_from, actions: As the settings say; the rate as the last reply, where they do not.
        seen: (H, W, 3) uint8, the head's picture of the last question; None if it had none.
    """

    def __init__(self, name: str, settings: DialectSettings, first: Sequence[str] | None = None) -> None:
        self.name, self._settings = name, settings
        self._first = {"cameras": None if first is None else list(first)}
        self.rate_hz, self.rate_from = settings.rate_hz, settings.rate_from
        self.actions: ActionKind = settings.actions or "absolute"
        self.vocabulary: Vocabulary = {}
        self.seen: NDArray[np.uint8] | None = None
        self._questions: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()
        self._answers: queue.SimpleQueue[Array | None] = queue.SimpleQueue()
        self._begin()

    def _begin(self) -> None:
        self.cameras = cameras_of(self._first, self._settings, self._settings.cameras)
        self.note, self.gave_up = "", False
        self._fresh = True
        self._held: Proprioception | None = None
        self._felt: Proprioception | None = None
        self._last: Array | None = None

    # --- in the episode's thread

    def reset(self) -> None:
        """Begin anew with the next question."""
        self._begin()

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """The next actions, (H, A), once there is an answer. Raises Stopped."""
        self._felt = observation["proprioception"]
        if self._held is None:
            self._held = self._felt
        self.seen = observation["images"]["head"].rgb if "head" in observation["images"] else None
        self._questions.put(question(observation, self._settings, self._fresh, self.vocabulary))
        self._fresh = False
        actions = self._answers.get()
        if actions is None:
            raise Stopped
        return actions

    # --- in the other thread

    def asked(self) -> dict[str, Any] | None:
        """The next message, once there is one; None: the episode is over."""
        return self._questions.get()

    def answer(self, reply: Mapping[str, Any]) -> None:
        """Answer the last question.

        Raises:
            PolicyError: "bad_reply": the reply is none; the question is still open.
        """
        assert self._held is not None
        actions = actions_of(reply, self._settings.action, self._held, self._felt)
        self.cameras = cameras_of(reply, self._settings, self.cameras)
        if isinstance(note := reply.get("note"), str):
            self.note = one_line(note)
        self.gave_up = reply.get("gave_up") is True
        if self._settings.rate_hz is None and "rate_hz" in reply:
            try:
                self.rate_hz, self.rate_from = check_rate(reply["rate_hz"]), "the server"
            except UserError as error:
                raise PolicyError("bad_reply", f"rate_hz in the reply: {error}") from None
        self._last = actions[-1]
        self._answers.put(actions)

    def hold(self) -> None:
        """Answer the last question without a reply, for a step: the base stands, joints go on to their last targets."""
        assert self._felt is not None
        action = (command_of(self._felt) if self._last is None else self._last).copy()
        layout_of(self._felt).set_velocity(action, 0.0)
        self._answers.put(action[None])

    def over(self) -> None:
        """Say that no more questions will come."""
        self._questions.put(None)

    def stop(self) -> None:
        """Say that no more answers will come."""
        self._answers.put(None)
