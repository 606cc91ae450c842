"""The likely cause of a handoff's end, in a sentence, from its figures by rules in a fixed order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from mpvi_bt.executive.monitors.handoff import (
    COMPLETE,
    CUT_OFF,
    INTERRUPTED,
    NEW_PROMPT,
    POLICY_DONE,
    POLICY_GAVE_UP,
    Handoff,
    says_done,
)


@dataclass(frozen=True)
class CauseThresholds:
    """When a figure counts as a cause. Our choice: each was set before any handoff was looked at."""

    clipped: float = 0.5  # share of the actions that were clipped; every second one is no slip
    waited: float = 0.5  # share of the time spent waiting for answers; the policy is then slower than the robot
    still: float = 0.5  # share of the time without motion; a policy that waits for the checker may use the rest to act
    empty: int = 2  # times that hands closed on nothing; once may be meant, as to press with a closed hand
    shortest_s: float = 2.0  # the motion in a shorter handoff tells nothing [s]; a reach takes longer
    slow: float = 1.0  # wall time of an answer per time of its actions [ratio]; above 1 a real robot would wait


_AT = CauseThresholds()


class Cause(NamedTuple):
    """A likely cause: a stable code, and a sentence for a person."""

    code: str
    sentence: str


def likely_cause(handoff: Handoff) -> Cause | None:
    """The first matching rule; None if the handoff is complete or ended for an outside reason."""
    if handoff.stopped_reason in (COMPLETE, NEW_PROMPT):
        return None
    return next((cause for rule in _RULES if (cause := rule(handoff)) is not None), None)


def _not_judged(h: Handoff) -> Cause | None:
    """The policy stopped and no checker judged it: only the goal shows if that was right."""
    if h.stopped_reason != POLICY_DONE or h.judged:
        return None
    return Cause("not_judged", "no checker worked beside it")


def _false_no(h: Handoff) -> Cause | None:
    if not h.false_noes:
        return None
    return Cause("false_no", f"the checker said no to what was there{_times(h.false_noes)}")


def _clipped(h: Handoff) -> Cause | None:
    if not h.steps or h.clipped < _AT.clipped * h.steps:
        return None
    count = "every action was" if h.clipped == h.steps else f"{h.clipped} of {h.steps} actions were"
    where = next(iter(h.clipped_at), "")
    return Cause("clipped", f"{count} clipped" + (f": {where}" if where else ""))


def _waited(h: Handoff) -> Cause | None:
    if not h.waited_s or h.waited_s < _AT.waited * h.length_s:
        return None
    return Cause("waited", f"the robot waited for the policy's answers for {_of(h.waited_s, h)}")


def _never_moved(h: Handoff) -> Cause | None:
    """The arms have not moved, nor base, torso and fingers."""
    moved = h.base_m or h.base_rad or h.torso or any(hand.arm_rad or hand.gripped for hand in h.hands.values())
    return None if moved else _still(h)


def _closed_on_nothing(h: Handoff) -> Cause | None:
    empty = sum(hand.empty for hand in h.hands.values())
    if empty < _AT.empty or any(hand.grasped > hand.lost for hand in h.hands.values()):
        return None
    return Cause("closed_on_nothing", f"it closed on nothing{_times(empty)}")


def _lost(h: Handoff) -> Cause | None:
    sides = [side for side, hand in h.hands.items() if hand.lost and hand.lost >= hand.grasped]
    if not sides:
        return None
    return Cause("lost", f"the {' and the '.join(sides)} hand lost what it held")


def _done_but(h: Handoff) -> Cause | None:
    """The policy takes it for done."""
    if h.stopped_reason != POLICY_DONE and not says_done(h.said):
        return None
    if h.noes:
        return Cause("said_no", f"the policy said that it was done, and the checker said no{_times(h.noes)}{_last(h)}")
    if h.unanswered:
        return Cause("unanswered", "the policy said that it was done, and the checker gave no answer")
    return Cause("not_asked", "the policy said that it was done, and no event had the checker asked")


def _gave_up(h: Handoff) -> Cause | None:
    if h.stopped_reason != POLICY_GAVE_UP:
        return None
    return Cause("gave_up", "the policy gave up" + (f": {h.said}" if h.said else ""))


def _still(h: Handoff) -> Cause | None:
    if h.length_s < _AT.shortest_s or h.still_s < _AT.still * h.length_s:
        return None
    but = f", and the checker said no{_times(h.noes)}" if h.noes else ""
    if h.told_still_s >= _AT.still * h.length_s:
        return Cause("held_still", f"the policy held still for {_of(h.still_s, h)}{but}")
    return Cause("not_followed", f"the robot did not follow its commands: it stood still for {_of(h.still_s, h)}{but}")


def _said_no(h: Handoff) -> Cause | None:
    if h.noes and h.noes == h.asked:
        return Cause("said_no", f"the checker said no{_times(h.noes)}{_last(h)}")
    return None


def _unanswered(h: Handoff) -> Cause | None:
    if not h.unanswered:
        return None
    return Cause("unanswered", f"the checker gave no answer to {h.unanswered} question{'s' * (h.unanswered > 1)}")


def _slow(h: Handoff) -> Cause | None:
    if not slow(h):
        return None
    took = f"an answer took {h.wall_mean_s:.2f} s and its actions {h.length_s / h.chunks:.2f} s"
    return Cause("slow", f"{took}: a real robot would wait for the rest")


def _by_end(h: Handoff) -> Cause | None:
    """The cause by the ending, if the figures show nothing."""
    if h.stopped_reason in (INTERRUPTED, CUT_OFF):
        return None
    if not h.steps:
        return Cause("no_action", "it ended before the policy gave an action")
    if h.stopped_reason in ("timeout", "time_limit"):
        asked = ", and no event had the checker asked" if h.judged and not h.asked and not h.unanswered else ""
        return Cause("too_long", f"the time was up while the policy was still moving{asked}")
    return None


def slow(handoff: Handoff) -> bool:
    """Whether answers took longer, in wall time, than the actions that they brought."""
    return handoff.chunks > 0 and handoff.wall_mean_s * handoff.chunks > _AT.slow * handoff.length_s


_RULES: Sequence[Callable[[Handoff], Cause | None]] = (
    _not_judged, _false_no, _clipped, _waited, _never_moved, _closed_on_nothing, _lost, _done_but, _gave_up, _still,
    _said_no, _unanswered, _slow, _by_end,
)  # fmt: skip


def _times(count: int) -> str:
    return "" if count == 1 else f" {count} times"


def _last(h: Handoff) -> str:
    return f", at last to {h.last_no}" if h.last_no else ""


def _of(seconds: float, h: Handoff) -> str:
    return f"{seconds:.0f} of {h.length_s:.0f} s" if h.length_s >= 10 else f"{seconds:.1f} of {h.length_s:.1f} s"
