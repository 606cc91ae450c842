"""The interface to language models: messages in, an answer out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

Schema = Mapping[str, Any]


@dataclass(frozen=True)
class Message:
    """One message of a conversation.

    Attributes:
        role: Whose it is.
        text: What it says.
        png: A picture beside the text, as the bytes of a PNG file; only a user's message may have one.
    """

    role: Literal["system", "user", "assistant"]
    text: str
    png: bytes | None = None


@dataclass(frozen=True)
class Answer:
    """What a model said, and what it took.

    Attributes:
        text: As it came: untrusted, whatever was asked for; of bounded size.
        model: Which model the server says that it was.
        latency_s: Wall time from the question to the answer, with all that was tried again; on file: as it was then.
        tokens_in: Of the question, as the server counts them; 0 if it does not say.
        tokens_out: Of the answer, likewise.
        tries: How often the question was put until there was an answer.
        kept: Whether it came from the exchanges on file, and cost nothing.
    """

    text: str
    model: str
    latency_s: float = 0.0
    tokens_in: int = 0
    tokens_out: int = 0
    tries: int = 1
    kept: bool = False


class ChatModel(Protocol):
    """A language model, or one that sees as well. It may be asked from several threads at once.

    Attributes:
        name: As given on the command line, such as "openai:gpt-5".
    """

    name: str

    def ask(self, messages: Sequence[Message], schema: Schema | None = None) -> Answer:
        """Wait for the model's answer.

        Args:
            messages: The conversation so far; the last one is answered.
            schema: JSON Schema of an object that the answer should be. A server that does not offer this is asked for
                JSON, or for nothing of the kind: whoever asks parses what comes, and checks it.

        Raises:
            ModelError: There is no answer, or none that can be one.
        """
        ...
