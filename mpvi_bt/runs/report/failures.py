"""Failures of episodes: reason codes, how they ended, and unmet predicates of the goal."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from mpvi_bt.runs.episode.result import FailureRecord, Result

# What a policy gave up of stands in the evidence: "pick: no_grasp", with what its candidates died of in brackets or
# words behind a colon, and behind a semicolon what the checker said no to; of two policies, behind the name of one
# ("learned: missed"); of a whole instruction, behind the clause ("3 of 7, open the fridge: open: no_door"); of a
# timeout, "manipulate (pick: no_grasp)".
_GAVE_UP = {
    "gave_up": re.compile(r"^(?:\d+ of \d+, [^:]*: )?((?:[a-z_]+: )*[a-z_]+)(?=: | \(|;|$)"),
    "timeout": re.compile(r"\bmanipulate(?:#\d+)? \(((?:[a-z_]+: )+[a-z_]+)(?=: | \(|\))"),
}
# As the goal's conditions are printed: a predicate stands before its arguments, "inside(a, b)", or, where a condition
# is kept in BDDL's own words, behind a bracket: "(inside a b)".
_PREDICATE = re.compile(r"(\bnot |\(not \()?(?:\b([a-z_]+)\(|\(([a-z_]+) (?=[a-z_]+\.n\.))")


@dataclass(frozen=True)
class Failures:
    """What is counted over episodes.

    Attributes:
        episodes: How many.
        reasons: Failures by reason code; an episode may have many.
        failed_with: Episodes by reason code: those in which it came up at least once.
        ended: Episodes by how they ended; "gave_up": the plan's end was reached, but not with all of its units.
        unmet: Conditions of the goal that did not hold at the end, by predicate, "not open" apart from "open".
    """

    episodes: int
    reasons: dict[str, int]
    failed_with: dict[str, int]
    ended: dict[str, int]
    unmet: dict[str, int]


def count_failures(results: Iterable[Result]) -> Failures:
    """Count over results; the most frequent first, then by name."""
    reasons: Counter[str] = Counter()
    failed_with: Counter[str] = Counter()
    ended: Counter[str] = Counter()
    unmet: Counter[str] = Counter()
    episodes = 0
    for result in results:
        episodes += 1
        codes = [reason(failure) for failure in result.failures]
        reasons.update(codes)
        failed_with.update(set(codes))
        ended["gave_up" if result.ended == "success" and result.gave_up else result.ended] += 1
        for condition in result.goal:
            if not condition.satisfied:
                unmet.update(predicates(condition.condition))
    return Failures(episodes, *(dict(_ranked(c)) for c in (reasons, failed_with, ended, unmet)))


def reason(failure: FailureRecord) -> str:
    """A failure's reason code, with the policy's own cause if it gave one, as in "timeout (pick: no_grasp)"."""
    said = _GAVE_UP.get(failure.reason)
    gave_up = said.search(failure.feedback) if said else None
    return f"{failure.reason} ({gave_up[1]})" if gave_up else failure.reason or "no reason given"


def predicates(condition: str) -> set[str]:
    """Names of the predicates in a condition of a goal as it is printed, those negated as "not open"."""
    found = {("not " if m[1] else "") + (m[2] or m[3]) for m in _PREDICATE.finditer(condition)}
    return found or {"other"}


def _ranked(counter: Counter[str]) -> list[tuple[str, int]]:
    return sorted(counter.items(), key=lambda item: (-item[1], item[0]))
