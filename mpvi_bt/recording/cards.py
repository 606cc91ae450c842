"""The cards that a film begins and ends with: what the robot was told and plans; what of the goal holds, and q."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mpvi_bt.drawing.cells import cut
from mpvi_bt.drawing.endings import is_plan
from mpvi_bt.executive.loop import Outcome
from mpvi_bt.recording.frame_text import DIM, INK, INKS, PAPER, PITCH_PX, SIZE, plain, wrapped, write
from mpvi_bt.recording.labels import Color, Picture
from mpvi_bt.tree.spec import TreeSpec

_LEFT, _TOP = 64, 76  # of the first line [px]
_TITLE, _TEXT, _LIST = 2.0, 1.6, 1.25  # letters, of those that frames have
_STEP_PX = 36, 26  # from line to line of the text, and of the list
_FOOT_PX = 40  # below the list


def opening(title: str, about: str, tree: TreeSpec) -> Picture | None:
    """What the robot was told, and its plan as far as the tree is one; None where it was told nothing.

    Args:
        title: Of the episode.
        about: Who does what in it, or "".
        tree: As it is at the start.

    Returns:
        (720, 1280, 3) uint8 RGB.
    """
    if not tree.instruction:
        return None
    units = [node.spec.label for node in tree.nodes if node.depth == 1] if is_plan(tree) else []
    heading = f"The plan, {len(units)} units" if units else ""
    rows = [(unit.removeprefix("attempt: "), INK) for unit in units]
    card = _card(title, tree.instruction, heading, rows)
    for line in wrapped(about, SIZE[0] - 2 * _LEFT, 1):
        write(card, line, (_LEFT, SIZE[1] - _FOOT_PX // 2), DIM)
    return card


def closing(outcome: Outcome, tree: TreeSpec) -> Picture | None:
    """Each condition of the goal with whether it holds, and q; None where no goal was scored.

    Args:
        outcome: Of the episode.
        tree: As it is at the end.

    Returns:
        (720, 1280, 3) uint8 RGB.
    """
    if outcome.goal is None:
        return None
    q, _, ended = outcome.told(tree).partition(", ")
    marks = {True: ("[o] ", INKS["success"]), False: ("[x] ", INKS["failure"])}
    conditions = [(marks[c.satisfied][0] + c.text, marks[c.satisfied][1]) for c in outcome.goal.conditions]
    return _card(q, ended, "The goal, as the simulator's state has it", conditions)


def _card(title: str, text: str, heading: str, rows: Sequence[tuple[str, Color]]) -> Picture:
    """A title, a text, and a list under a heading: in full lines if they fit, else in two columns, its end counted."""
    card = np.full((SIZE[1], SIZE[0], 3), PAPER, np.uint8)
    room = SIZE[0] - 2 * _LEFT
    write(card, cut(plain(title), int(room / (PITCH_PX * _TITLE))), (_LEFT, _TOP), INK, _TITLE)
    y = _TOP + 20
    for line in wrapped(text, room / _TEXT, 4):
        y += _STEP_PX[0]
        write(card, line, (_LEFT, y), INK, _TEXT)
    y += 2 * _STEP_PX[1]
    write(card, heading, (_LEFT, y), DIM, _LIST)
    y += 8
    deep = (SIZE[1] - _FOOT_PX - y) // _STEP_PX[1]
    lines = [(line, ink) for row, ink in rows for line in _hanging(row, room / _LIST)]
    across = 1
    if len(lines) > deep:
        across, columns = 2, int(room / 2 / (PITCH_PX * _LIST)) - 2
        lines = [(cut(plain(row), columns), ink) for row, ink in rows]
        if len(lines) > deep * across:
            lines[deep * across - 1 :] = [(f"... {len(lines) - deep * across + 1} more", DIM)]
    deep = max(1, -(-len(lines) // across))
    for k, (line, ink) in enumerate(lines):
        at = _LEFT + k // deep * room // across, y + (k % deep + 1) * _STEP_PX[1]
        write(card, line, at, ink, _LIST)
    return card


def _hanging(row: str, width_px: float) -> list[str]:
    """A row in full, its second line and those after it indented."""
    first, *more = wrapped(row, width_px - 4 * PITCH_PX, 9) or [""]
    return [first, *(f"    {line}" for line in more)]
