"""A handoff in words: why it ended, the likely cause, then its figures, a line a subject."""

from __future__ import annotations

from collections.abc import Iterator

from mpvi_bt.executive.monitors.causes import likely_cause, slow
from mpvi_bt.executive.monitors.handoff import (
    COMPLETE,
    CUT_OFF,
    INTERRUPTED,
    NEW_PROMPT,
    POLICY_DONE,
    POLICY_GAVE_UP,
    STILL_S,
    HandFigures,
    Handoff,
)

_ENDS = {
    COMPLETE: "complete",
    POLICY_DONE: "the policy said done",
    POLICY_GAVE_UP: "the policy gave up",
    NEW_PROMPT: "the prompt changed",
    CUT_OFF: "another part of the tree took over",
    INTERRUPTED: "interrupted",
    "time_limit": "the episode's time was up",
    "backend_error": "a server or model failed",
}
_MOST = 3  # kinds of clipped numbers that are listed


def handoff_line(handoff: Handoff) -> str:
    """Why it ended, and the likely cause, such as "timeout: the policy held still for 88 of 90 s"."""
    end, cause = _ENDS.get(handoff.stopped_reason, handoff.stopped_reason), likely_cause(handoff)
    return f"{end}: {cause.sentence}" if cause else end


def handoff_lines(handoff: Handoff) -> Iterator[str]:
    """Facts about a handoff, a line a subject; events that did not occur are left out."""
    h = handoff
    yield f"moved: {_moved(h)}"
    gripped = [f"{side} {text}" for side, hand in h.hands.items() if (text := _gripped(hand))]
    if gripped:
        yield f"hands: {'; '.join(gripped)}"
    if h.still_s:
        end = f", {h.last_still_s:.1f} s of it at the end" if h.last_still_s >= STILL_S else ""
        told = f"commands asked for no motion in {h.told_still_s:.1f} s"
        yield f"stood still: {h.still_s:.1f} of {h.length_s:.1f} s{end}; {told}"
    if h.chunks:
        yield f"answers: {_answers(h)}"
    if h.waited_s:
        yield f"waited: {h.waited_s:.1f} s for want of an action"
    if h.clipped:
        where = [f"{name} {count}" for name, count in list(h.clipped_at.items())[:_MOST]]
        yield f"clipped: {h.clipped} of {h.steps} actions ({', '.join(where)})"
    if h.judged:
        yield f"checker: {_checked(h)}"


def _moved(h: Handoff) -> str:
    parts = [f"base {h.base_m:.2f} m" + (f" and {h.base_rad:.1f} rad" if h.base_rad else "")] if h.base_m else []
    parts += [f"base {h.base_rad:.1f} rad"] if h.base_rad and not h.base_m else []
    parts += [f"torso {h.torso:.2f}"] if h.torso else []
    parts += [f"{side} arm {hand.arm_rad:.1f} rad" for side, hand in h.hands.items() if hand.arm_rad]
    return ", ".join(parts) or "neither base nor arms"


def _gripped(hand: HandFigures) -> str:
    parts = [
        (hand.grasped, "closed on something"),
        (hand.empty, "closed on nothing"),
        (hand.lost, "lost what it held"),
        (hand.opened, "opened"),
    ]
    return ", ".join(f"{what} {count} time{'s' * (count > 1)}" for count, what in parts if count)


def _answers(h: Handoff) -> str:
    size = f"{h.shortest_chunk}" if h.shortest_chunk == h.longest_chunk else f"{h.shortest_chunk} to {h.longest_chunk}"
    told = f"{h.chunks}, each of {size} action{'s' * (h.longest_chunk > 1)}"
    if h.wall_most_s:
        told += f", in {h.wall_mean_s:.3f} s each (wall time), at most {h.wall_most_s:.3f} s"
        told += "; slower than the robot acts" if slow(h) else ""
    return told


def _checked(h: Handoff) -> str:
    if not h.asked and not h.unanswered:
        return "not asked"
    told = f"asked {h.asked + h.unanswered} time{'s' * (h.asked + h.unanswered > 1)}, {h.noes} no"
    told += f" ({h.false_noes} wrong by the simulator's state)" if h.false_noes else ""
    told += f", {h.unanswered} without an answer" if h.unanswered else ""
    return told + (f"; the last no: {h.last_no}" if h.last_no else "")
