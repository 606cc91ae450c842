"""First and last picture of a film: instruction and plan; goal conditions and q."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mpvi_bt.executive.drawing.cells import cut
from mpvi_bt.executive.drawing.endings import is_plan
from mpvi_bt.executive.ticking.loop import Outcome
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.ground.words.spoken import spoken_texts
from mpvi_bt.runs.recording import search_colors as colors
from mpvi_bt.runs.recording.drawn_map import hatched
from mpvi_bt.runs.recording.frame_text import DIM, INK, INKS, LEGEND, PAPER, PITCH_PX, SIZE, plain, wrapped, write
from mpvi_bt.runs.recording.labels import Color, Picture

_LEFT, _TOP = 64, 76  # of the first line [px]
_TITLE, _TEXT, _LIST = 2.0, 1.6, 1.25  # letters, of those that frames have
_STEP_PX = 36, 26  # from line to line of the text, and of the list
_FOOT_PX, _LEGEND_PX = 40, 18  # below the list, and of a line of the legend there
_SWATCH = (22, 12)
# Of the map of a search.
_MAP_COLORS: tuple[tuple[str, Color], ...] = (
    ("seen", colors.SEEN),
    ("in view", colors.IN_VIEW),
    ("not seen", colors.UNSEEN),
    ("not known", colors.UNKNOWN),
    ("wall, furniture", colors.WALL),
    ("frontier", colors.FRONTIER),
    ("path, goal", colors.PATH),
    ("way", colors.WAY),
    ("found", colors.FOUND),
    ("robot", colors.ROBOT),
)


def opening(title: str, about: str, tree: TreeSpec, search: bool = False) -> Picture:
    """The first card: the instruction, the plan as far as the tree is one, and a legend.

    Args:
        title: Of the episode.
        about: Who does what in it, or "".
        tree: As it is at the start.
        search: Whether frames show the map of a search.

    Returns:
        (720, 1280, 3) uint8 RGB.
    """
    units = [node.spec.label for node in tree.nodes if node.depth == 1] if is_plan(tree) else []
    heading = f"The plan, {len(units)} units" if units else ""
    rows = [(unit.removeprefix("attempt: "), INK) for unit in units]
    below = [*wrapped(about, SIZE[0] - 2 * _LEFT, 1), *LEGEND]
    foot = _FOOT_PX + _LEGEND_PX * (len(below) - 1 + search)
    card = _card(title, tree.instruction or tree.about, heading, rows, foot)
    y = SIZE[1] - foot + _FOOT_PX // 2
    for line in below:
        write(card, line, (_LEFT, y), DIM)
        y += _LEGEND_PX
    if search:
        _write_colors(card, y)
    return card


def _write_colors(card: Picture, y: int) -> None:
    """What the colors of a search's map mean, in a line."""
    left, (width, height) = _LEFT, _SWATCH
    for word, color in _MAP_COLORS:
        card[y - height + 1 : y + 1, left : left + width] = hatched(color, (height, width))
        write(card, word, (left + width + 5, y), DIM)
        left += width + round((len(word) + 2) * PITCH_PX) + 5


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
    texts = spoken_texts(condition.text for condition in outcome.goal.conditions)
    marks = {True: ("✓ ", INKS["success"]), False: ("✕ ", INKS["failure"])}
    conditions = [
        (marks[condition.satisfied][0] + text, marks[condition.satisfied][1])
        for condition, text in zip(outcome.goal.conditions, texts, strict=True)
    ]
    return _card(q, ended, "The goal, as the simulator's state has it", conditions)


def _card(title: str, text: str, heading: str, rows: Sequence[tuple[str, Color]], foot: int = _FOOT_PX) -> Picture:
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
    deep = (SIZE[1] - foot - y) // _STEP_PX[1]
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
