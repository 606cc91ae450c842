"""Separates marked thinking from the answer: reasoning models write it first, marked in several ways."""

from __future__ import annotations

import re

_TAG = r"(?:\w{1,20}:)?(?:think|thinking|thoughts?|reasoning|reason|reflection|scratchpad|analysis)[>\]\u25b7]"
# As DeepSeek, Qwen, Seed, Mistral, Kimi, OpenThinker, Command A and gpt-oss mark it.
_MARK = re.compile(
    rf"""[<\[\u25c1](?:
        (?P<begin> {_TAG} | \|(?:begin_of_thought|START_THINKING)\|> | \|channel\|>(?:analysis|commentary) )
      | (?P<end> /{_TAG} | \|(?:end_of_thought|END_THINKING)\|> | \|channel\|>final(?:<\|message\|>)? )
    )""",
    re.IGNORECASE | re.VERBOSE,
)


def thinking(text: str) -> list[tuple[int, int]]:
    """Where the thinking is, from and to, in order.

    What is between a mark that begins it and one that ends it; before an end that nothing begins, everything, as some
    servers swallow the beginning. Thinking that does not end cannot be told from an answer, and is none.
    """
    spans: list[tuple[int, int]] = []
    begun: int | None = None
    for mark in _MARK.finditer(text):
        if mark["begin"]:
            begun = mark.start() if begun is None else begun
        elif begun is not None:
            spans.append((begun, mark.end()))
            begun = None
        else:
            spans = [(0, mark.end())]
    return spans


def spoken(text: str) -> str:
    """An answer without its thinking."""
    parts, at = [], 0
    for begin, end in thinking(text):
        parts.append(text[at:begin])
        at = end
    return "".join([*parts, text[at:]]).strip()
