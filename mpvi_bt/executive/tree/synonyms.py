"""Names of our node kinds in other behavior-tree libraries and in common speech.

From py_trees, BehaviorTree.CPP 3 and 4, and common speech. A word with no counterpart here is left out: a wrong hint
costs more than none.
"""

from __future__ import annotations

from collections.abc import Iterable

from mpvi_bt.ground.errors import nearest

_OTHERS = {
    "sequence": "and seq steps asyncsequence reactivesequence sequencewithmemory sequencestar",
    "selector": "or fallback priority asyncfallback reactivefallback fallbackstar choice ifthenelse switch",
    "parallel": "all parallelall simultaneous concurrent",
    "attempt": "try optional forcesuccess failureissuccess ignorefailure",
    "timeout": "deadline timelimit",
    "retry": "retries retryuntilsuccessful",
    "repeat": "loop for keeprunninguntilfailure",
    "invert": "inverter not negate",
    "condition": "if when while guard precondition eternalguard whiledoelse",
    "cooldown": "throttle ratelimit",
    "subtree": "tree call include subtreeplus import",
    "navigate": "goto move moveto drive driveto go navigateto",
    "manipulate": "action act pick place grasp pickup",
    "look_around": "turn rotate spin scan",
    "wait": "sleep delay pause timer",
    "say": "log print echo message",
    "set": "script setblackboard setblackboardvariable assign",
    "test": "assert checkblackboardvariablevalue checkblackboardvariableexists scriptcondition",
    "succeed": "success alwayssuccess pass ok",
    "fail": "failure alwaysfailure failed",
}
_OURS = {word: kind for kind, words in _OTHERS.items() for word in words.split()}


def meant(given: str, kinds: Iterable[str]) -> str | None:
    """The kind that was probably meant: a word from elsewhere or a near match; else None."""
    known = list(kinds)
    plain = {kind.replace("_", ""): kind for kind in known}
    word = given.replace("_", "").replace("-", "").replace(" ", "").lower()
    return plain.get(word) or _OURS.get(word) or nearest(given, known)
