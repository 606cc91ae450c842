"""S-expressions, the syntax of BDDL, with the position of every word."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Mapping
from typing import Self

from mpvi_bt.house.goals.findings import Findings, Place

MAX_CHARS = 200_000
MAX_DEPTH = 50
SECTIONS = (":objects", ":init", ":goal")
QUANTIFIERS = ("forall", "exists", "forn", "forpairs", "fornpairs")
CONNECTIVES = ("and", "or", "not", "imply", *QUANTIFIERS)

_TOKEN = re.compile(r"[()]|[^\s()]+")


class Word(str):
    """A word.

    Attributes:
        place: 1-based (line, column).
    """

    place: Place

    def __new__(cls, text: str, place: Place = (0, 0)) -> Self:
        """The word of a text."""
        word = super().__new__(cls, text)
        word.place = place
        return word


class Form(list["Word | Form"]):
    """What stands between two parentheses.

    Attributes:
        place: 1-based (line, column) of the opening one.
        end: The same of the closing one.
    """

    def __init__(self, items: Iterable[Expression] = (), place: Place = (0, 0)) -> None:
        super().__init__(items)
        self.place = self.end = place


Expression = Word | Form


def read_expressions(text: str, findings: Findings) -> list[Expression]:
    """The expressions of a text, which may have comments after ";". A form's first word is taken in lower case.

    Raises:
        FileProblems: It is too long or nested too deep, or its parentheses do not match.
    """
    if len(text) > MAX_CHARS:
        findings.stop((0, 0), "too-large", f"{len(text)} characters, more than {MAX_CHARS}")
    stack = [Form()]
    for number, line in enumerate(text.split("\n"), 1):
        for token in _TOKEN.finditer(line.split(";")[0]):
            place = (number, token.start() + 1)
            if token[0] == "(":
                stack.append(Form(place=place))
            elif token[0] != ")":
                name = token[0] if stack[-1] or token[0].startswith("?") else token[0].lower()
                stack[-1].append(Word(name, place))
            elif len(stack) > 1:
                done = stack.pop()
                done.end = place
                stack[-1].append(done)
            else:
                findings.stop(place, "syntax", f"')' closes nothing{_closed(stack[0])}")
            if len(stack) > MAX_DEPTH:
                findings.stop(place, "too-deep", f"parentheses nest deeper than {MAX_DEPTH}")
    if len(stack) > 1:
        for outer, inner in itertools.pairwise(stack):
            outer.append(inner)
        around, before = stack[-1], ""
        if (found := _open(stack[1])) is not None:
            around, held = found
            before = f" before {_begin(held)} on line {held.place[0]}"
        findings.stop(around.place, "syntax", f"{_begin(around)} is not closed{before}: '(' without ')'")
    return list(stack[0])


def written(expression: Expression, names: Mapping[str, str] | None = None) -> str:
    """The expression as written, without question marks, and with the variables that `names` binds replaced."""
    if isinstance(expression, Word):
        word = expression.lstrip("?")
        return (names or {}).get(word, word)
    return f"({' '.join(written(part, names) for part in expression)})"


def _begin(form: Form) -> str:
    """How it begins, for a person."""
    return f"'({form[0]:.40}'" if form and isinstance(form[0], Word) else "'('"


def _closed(top: Form) -> str:
    """The place of the last closing parenthesis, which may be too early."""
    last = top[-1] if top else None
    return f"; {_begin(last)} is closed on line {last.end[0]} already" if isinstance(last, Form) else ""


def _open(form: Form) -> tuple[Form, Form] | None:
    """The first form with an illegal form inside, and that form: a parenthesis is missing there."""
    head = form[0] if form and isinstance(form[0], Word) else None
    for part in form:
        if not isinstance(part, Form):
            continue
        section = bool(part) and part[0] in SECTIONS
        if (section and head != "define") or (head is not None and head not in (*CONNECTIVES, *SECTIONS, "define")):
            return form, part
        if (found := _open(part)) is not None:
            return found
    return None
