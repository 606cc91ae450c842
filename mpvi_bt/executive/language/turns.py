"""Roles that a model takes: not every chat template has a system role, and in some, roles must alternate.

What a model was found to take is remembered in this process, by endpoint and name, so that nobody finds it out again.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

Turn = Mapping[str, Any]  # as the protocol has it: role, and content as a text or as parts


def as_given(turns: Sequence[Turn]) -> list[Turn]:
    """Unchanged."""
    return list(turns)


def alternating(turns: Sequence[Turn]) -> list[Turn]:
    """Neighbors of the same role as one turn."""
    joined: list[Turn] = []
    for turn in turns:
        if joined and joined[-1]["role"] == turn["role"]:
            turn = {**turn, "content": _joined(joined.pop()["content"], turn["content"])}
        joined.append(turn)
    return joined


def without_system(turns: Sequence[Turn]) -> list[Turn]:
    """System texts become the beginning of the user's next turn; roles alternate."""
    return alternating([{**turn, "role": "user"} if turn["role"] == "system" else turn for turn in turns])


SHAPES: tuple[Callable[[Sequence[Turn]], list[Turn]], ...] = (as_given, alternating, without_system)
TOLD = (  # of each
    "",
    "it takes no two turns of the same role in a row: they are sent as one, from now on",
    "it takes no system role: that text stands before the user's first words, from now on",
)


@dataclass
class Taken:
    """What a model takes.

    Attributes:
        shape: Index in `SHAPES` of what it took.
        known: Whether it need not be found out: it took one, or none helped where roles were not named as the reason.
    """

    shape: int = 0
    known: bool = False

    def next_shape(self, turns: Sequence[Turn], shape: int) -> int | None:
        """The next one that changes anything about a conversation; None: there is none."""
        sent = SHAPES[shape](turns)
        return next((i for i in range(shape + 1, len(SHAPES)) if SHAPES[i](turns) != sent), None)


_taken: dict[tuple[str, str], Taken] = {}


def taken_by(url: str, model: str) -> Taken:
    """What is known of a model at an endpoint, to be read and written."""
    return _taken.setdefault((url, model), Taken())


def forget() -> None:
    """Know of no model any more."""
    _taken.clear()


# How servers say that a chat template takes no such conversation: of roles, or of the template alone.
_ROLES = re.compile(
    r"\broles?\b.{0,80}\b(?:alternat|support|allow|accept|system)|roles? must alternate"
    r"|(?:unexpected|unsupported|invalid|unknown|no|only)\b.{0,30}\b(?:system|roles?)\b"
    r"|\b(?:system|developer)['\"`]?\s+(?:role|message|prompt|instruction)s?\b.{0,30}(?:\bnot\b|n't\b|\bun)"
    r"|jinja|(?:chat|prompt).?template|template.?error|raise_exception",
    re.IGNORECASE,
)
# Of a server that broke at the question, or refuses it, and does not say why.
_SILENT = re.compile(
    r"\((?:400|422|500)\)(?:: (?:Internal Server Error|Bad Request|Unprocessable (?:Entity|Content)|\{\}))?\W*$"
)


def names_roles(told: str) -> bool:
    """Whether a server complains of the roles in a conversation, or of its own template for them."""
    return _ROLES.search(told) is not None


def says_nothing(told: str) -> bool:
    """Whether a server refuses a question or breaks at it without a word why: roles may be the reason."""
    return _SILENT.search(told) is not None


def _joined(first: Any, second: Any) -> Any:
    """Two contents as one; texts that meet are one text."""
    if isinstance(first, str) and isinstance(second, str):
        return f"{first}\n\n{second}"
    parts = [*_parts(first), *_parts(second)]
    at = len(_parts(first))
    if parts[at - 1]["type"] == parts[at]["type"] == "text":
        parts[at - 1 : at + 1] = [{"type": "text", "text": _joined(parts[at - 1]["text"], parts[at]["text"])}]
    return parts


def _parts(content: Any) -> list[Any]:
    return [{"type": "text", "text": content}] if isinstance(content, str) else list(content)
