"""An explanation as text, for people: an outline from the root down, each node's evidence under it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import TypeVar

from mpvi_bt.executive.drawing.cells import columns, cut, one_line
from mpvi_bt.executive.monitors.handoff_text import handoff_line, handoff_lines
from mpvi_bt.executive.trace.explain import Diagnosis, Explanation, Link, Recovery
from mpvi_bt.ground.errors import with_article

_Item = TypeVar("_Item")

_EVENTS = {"idle": "idling", "periodic": "so many steps"}  # of what no noun is meant
_WHOLE = 2  # chains of units given up; of more only the reasons are shown; --json has all of everything
_UNITS = 12  # given up, the last
_SHOWN = 5  # earlier failures and answers, the last
_HANDOFFS = 6  # to the policy that did not end by the checker's yes, the last; those that did only get their line
_INDENT = 2
_NUMBER_S = re.compile(r"(\d) s\b")  # no line ends within
_LEAST = 40  # columns that indentation leaves


def explanation_text(explanation: Explanation, width: int = 80) -> str:
    """The explanation for a person, no line wider than `width`."""
    e = explanation
    text = _WrappedLines(width)
    text.add(f"{e.tree}: {e.told}, tick {e.tick}")
    if e.conditions:
        text.add(f"{e.conditions - len(e.unmet)} of {e.conditions} conditions of the goal hold", 1)
    for condition in text.first(e.unmet, 1):
        text.add(f"not met: {condition}", 1)
    if e.error is not None:
        text.add(f"{e.error.reason}: {e.error.message}" if e.error.reason else e.error.message, 1)
        if e.error.path:
            text.add(f"in {e.error.path}", 1)
        if e.error.place:
            text.add(f"at {e.error.place}", 1)
    if e.cause is not None:
        text.gap()
        text.chain(e.cause, 0)
    if e.unanswered:
        last = e.unanswered[-1]
        questions = f"{len(e.unanswered)} question{'s' * (len(e.unanswered) != 1)}"
        text.gap()
        text.add(f"{questions} to the checker got neither yes nor no. The last one:")
        text.add(f'at {last.time_s:.1f} s, "{last.answer.criterion}": {last.answer.reason}', 1)
    if e.running:
        text.gap("Running then:")
        for link in e.running:
            text.leaf(link, 1)
    if e.recovered:
        text.gap("Recovered on the way:")
        for recovery in text.last(e.recovered, "before", 1, _UNITS):
            text.recovery(recovery, 1)
    if e.gave_up:
        units = "1 unit was given up" if len(e.gave_up) == 1 else f"{len(e.gave_up)} units were given up"
        text.gap(f"{units} on the way:")
        whole = len(e.gave_up) <= _WHOLE
        for link in e.gave_up if whole else text.last(e.gave_up, "before", 1, _UNITS):
            if whole:
                text.chain(link, 1)
                text.replanned(link, 3)
            else:
                text.head(link, 1)
                text.reasons(link, 3)
                text.replanned(link, 3)
    if e.diagnosis or e.undiagnosed:
        text.handoffs(e.diagnosis, len(e.undiagnosed))
    return text.text


class _WrappedLines:
    """Lines that are wrapped and indented, up to a width."""

    def __init__(self, width: int) -> None:
        self.width = width
        self.lines: list[str] = []

    @property
    def text(self) -> str:
        return "\n".join(self.lines)

    def gap(self, title: str = "") -> None:
        self.lines += ["", title] if title else [""]

    def add(self, text: str, depth: int = 0) -> None:
        import wcwidth  # loads tables

        indent = self._indent(depth)
        whole = _NUMBER_S.sub("\\1\N{NO-BREAK SPACE}s", one_line(text))
        lines = wcwidth.wrap(whole, self.width, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False)
        self.lines += [line.replace("\N{NO-BREAK SPACE}", " ") for line in lines]

    def chain(self, link: Link, depth: int) -> None:
        """A node, why it failed, and what is below it."""
        self.head(link, depth)
        if link.reason:
            self.add(_why(link), depth + 2)
        for below in link.below:
            self.chain(below, depth + 1)
        if link.below or link.status == "SUCCESS":
            return
        self.add(f"node: {link.path}", depth + 2)
        if link.interrupted:
            self.add("still running:", depth + 2)
        for inner in link.interrupted:
            self.leaf(inner, depth + 3)
        self.asked(link, depth + 2)
        for earlier in self.last(link.earlier, "earlier failures", depth + 2):
            self.add(f"before, at {earlier.time_s:.1f} s: {earlier.label}: {_why(earlier)}", depth + 2)

    def head(self, link: Link, depth: int) -> None:
        """A node, with its times at the right."""
        self.title(f"{link.glyph} {one_line(link.label)}", link.began_s, link.time_s, depth)

    def title(self, text: str, began_s: float, ended_s: float, depth: int) -> None:
        """A line with the times of what it is about at the right."""
        began, ended = f"{began_s:.1f} s", f"{ended_s:.1f} s"
        when = f"at {ended}" if began == ended else f"{began} to {ended}"
        head = self._indent(depth) + one_line(text)
        head = cut(head, self.width - len(when) - 2)
        self.lines.append(head + " " * (self.width - columns(head) - len(when)) + when)

    def reasons(self, link: Link, depth: int) -> None:
        """Each failure of its own in a chain, in order."""
        if link.reason:
            self.add(f"{link.label}: {_why(link)}", depth)
        for below in link.below:
            self.reasons(below, depth)

    def recovery(self, recovery: Recovery, depth: int) -> None:
        """A node that went on in spite of failures, those failures, and the later success."""
        self.head(recovery.node, depth)
        for failed in self.last(recovery.failed, "earlier failures", depth + 2):
            self.add(f"{failed.time_s:.1f} s: {failed.label}: {_why(failed)}", depth + 2)
        what = f"try {recovery.tries} succeeded" if recovery.tries else f"succeeded: {recovery.by}"
        self.add(f"{recovery.node.time_s:.1f} s: {what}", depth + 2)

    def replanned(self, link: Link, depth: int) -> None:
        """The result of its request for a new plan."""
        if (plan := link.replanned) is None:
            return
        count = f"{plan.segments} segment{'s' * (plan.segments != 1)}"
        came = f"no new plan: {plan.said}" if plan.segments is None else f"a new plan of {count}"
        took = f", answered in {plan.latency_s:.1f} s" if plan.latency_s else ""
        self.add(f"then {came}{took}", depth)

    def handoffs(self, all_: Sequence[Diagnosis], untold: int) -> None:
        """The policy's handoffs: those not complete in full, and a count of the others."""
        short = [one for one in all_ if not one.handoff.complete]
        confirmed = f"{len(all_) - len(short)} confirmed by a checker"
        count = f"{len(all_)} handoff{'s' * (len(all_) != 1)} to the policy, {confirmed}"
        self.gap(f"{count}{':' * bool(short)}" if all_ else "Handoffs to the policy:")
        left_out = len(short) - len(short[-_HANDOFFS:])
        if left_out:
            self.add(f"{left_out} before that {'was' if left_out == 1 else 'were'} not complete, then", 1)
        for one in short[-_HANDOFFS:]:
            h = one.handoff
            self.title(f'"{h.prompt}"', h.began_s, h.ended_s, 1)
            self.add(handoff_line(h), 2)
            for line in handoff_lines(h):
                self.add(line, 3)
        if untold:
            nodes = f"{untold} node{'s' * (untold > 1)}"
            self.add(f"of {nodes} the trace does not tell: a stand-in did its work, or an older mpvi_bt wrote it", 1)

    def leaf(self, link: Link, depth: int) -> None:
        """A node that was running, and its last words."""
        self.add(f"{link.glyph} {link.label}, since {link.began_s:.1f} s", depth)
        if link.feedback:
            self.add(link.feedback, depth + 2)
        self.asked(link, depth + 2)

    def asked(self, link: Link, depth: int) -> None:
        for asked in self.last(link.asked, "earlier questions", depth):
            answer = asked.answer
            said = ", ".join(filter(None, (answer.said, answer.reason)))
            by = f"after {_EVENTS.get(answer.event) or with_article(answer.event)}" + (
                f", {answer.camera} camera" if answer.camera else ""
            )
            by += f", answered in {answer.latency_s:.1f} s" if answer.latency_s else ""
            self.add(f'asked at {asked.time_s:.1f} s ({by}): "{answer.criterion}"? {said}', depth)

    def first(self, items: Sequence[_Item], depth: int, shown: int = _UNITS) -> Iterator[_Item]:
        """The first few, and then a line that counts the others."""
        yield from items[:shown]
        if len(items) > shown:
            self.add(f"and {len(items) - shown} more", depth)

    def last(self, items: Sequence[_Item], what: str, depth: int, shown: int = _SHOWN) -> Sequence[_Item]:
        """The last few, after a line that counts the others."""
        if len(items) > shown:
            left = len(items) - shown
            self.add(f"{left} {what if left > 1 else what.removesuffix('s')}, then", depth)
        return items[-shown:]

    def _indent(self, depth: int) -> str:
        return " " * min(_INDENT * depth, max(self.width - _LEAST, 0))


def _why(link: Link) -> str:
    return f"{link.reason}: {link.evidence}" if link.evidence else link.reason
