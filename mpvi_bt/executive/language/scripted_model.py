"""A scripted model, for tests and for trying things out without a real one."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence

from mpvi_bt.executive.language.chat import Answer, Message, Schema
from mpvi_bt.ground.errors import ModelError

Says = str | Answer | Exception


class ScriptedChatModel:
    """Answers from a list, in order, or by a function of the question.

    Args:
        answers: Texts, whole answers, or errors to raise; or a function from the messages to one of these.
        name: Its name.
        latency_s: What answers that are texts say that they took; nobody waits for it.

    Attributes:
        asked: The questions so far: messages and schema, in order.
    """

    def __init__(
        self,
        answers: Iterable[Says] | Callable[[Sequence[Message]], Says],
        name: str = "scripted",
        latency_s: float = 0.0,
    ) -> None:
        self.name = name
        self.asked: list[tuple[tuple[Message, ...], Schema | None]] = []
        self._latency_s = latency_s
        self._lock = threading.Lock()
        if callable(answers):
            self._say = answers
        else:
            script = iter(list(answers))
            self._say = lambda messages: next(script, ModelError("not_recorded", "the script has no more answers"))

    def ask(self, messages: Sequence[Message], schema: Schema | None = None) -> Answer:
        """The next answer. Raises what the script says, and ModelError once it has come to its end."""
        with self._lock:
            self.asked.append((tuple(messages), schema))
            said = self._say(messages)
        if isinstance(said, Exception):
            raise said
        if isinstance(said, Answer):
            return said
        words = sum(len(message.text.split()) for message in messages)
        return Answer(said, self.name, self._latency_s, words, len(said.split()))
