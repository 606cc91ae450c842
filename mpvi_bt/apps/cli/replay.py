"""`mpvi replay`: a recorded run, tick by tick, forward and back."""

from __future__ import annotations

import json
import os
import re
import sys
import termios
import tty
from collections.abc import Container, Iterator, Mapping
from dataclasses import asdict
from typing import Any

import click

from mpvi_bt.apps.cli.argument_types import File
from mpvi_bt.executive.drawing.cells import WIDEST, WIDTH, cut, one_line
from mpvi_bt.executive.drawing.colors import obeys_escapes, painted, wants_color
from mpvi_bt.executive.drawing.symbols import legend
from mpvi_bt.executive.drawing.terminal import draw, results, size, tell
from mpvi_bt.executive.drawing.text import left_out, node_line, tree_lines, where, window
from mpvi_bt.executive.trace.lines import Tick
from mpvi_bt.executive.trace.read import Trace, read_trace
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.executive.tree.state import NodeState

_PAGE = 10
_KEY = re.compile(r"\x1b[\[O][0-9;]*[A-Za-z~]|.", re.DOTALL)
_ESCAPES = {
    **dict.fromkeys(("\x1b[C", "\x1bOC", "\x1b[B", "\x1bOB", " ", "\r"), "n"),
    **dict.fromkeys(("\x1b[D", "\x1bOD", "\x1b[A", "\x1bOA", "\x7f"), "p"),
    "\x1b[6~": "page down",
    "\x1b[5~": "page up",
    **dict.fromkeys(("\x1b[H", "\x1bOH", "\x1b[1~", "\x1b[7~"), "home"),
    **dict.fromkeys(("\x1b[F", "\x1bOF", "\x1b[4~", "\x1b[8~"), "end"),
}
_HELP = "q quit  n next  p back  f next failure  PgDn/PgUp by 10  Home/End"


@click.command()
@click.argument("trace", type=File(), metavar="TRACE")
@click.option("--tick", type=click.IntRange(min=0), metavar="N", help="Print the whole tree after tick N.")
@click.option("--unicode", is_flag=True, help="Draw with lines and signs beyond ASCII.")
@click.option("--json", "as_json", is_flag=True, help="For programs: every tick's changes, or the state at --tick.")
def replay(trace: str, tick: int | None, unicode: bool, as_json: bool) -> None:
    """Show a recorded run, tick by tick, forward and back.

    TRACE is a file that `mpvi run` wrote beside its result, NAME.trace.jsonl. On a terminal, keys go through
    it; piped, every change is a line.
    """
    run = read_trace(trace)
    if tick is not None:
        run.require_tick(tick)
    if as_json:
        _print_json(run, tick)
    elif tick is not None:
        for line in _at(run, tick, unicode):
            tell(line)
    elif sys.stdin.isatty() and results().isatty() and obeys_escapes():
        Player(run, unicode).play()
    else:
        for line in _changes(run, unicode):
            tell(line)


def _print_json(trace: Trace, tick: int | None) -> None:
    if tick is not None:
        tell(json.dumps(_held(trace, tick), indent=2))
        return
    tell("[", nl=False)
    for i, change in enumerate(trace.ticks):
        shown = dict(vars(change))
        shown["nodes"] = {path: vars(state) for path, state in change.nodes.items()}
        for name in ("queries", "notices", "replans", "diagnosis"):
            shown[name] = [asdict(entry) for entry in shown[name]]
        tell((",\n " if i else "\n ") + json.dumps(shown), nl=False)
    tell("\n]")


def _held(trace: Trace, tick: int) -> dict[str, Any]:
    tree, _, blackboard = _standing(trace, trace.index_at(tick))
    states = trace.states_at(tick)
    return {
        "tick": tick,
        "time_s": trace.time_at(tick),
        "nodes": {node.path: vars(states.get(node.path, NodeState())) for node in tree.nodes},
        "blackboard": blackboard,
    }


def _standing(trace: Trace, i: int) -> tuple[TreeSpec, Mapping[str, NodeState], Mapping[str, Any]]:
    """Tree, states and blackboard after change i; -1: before the first."""
    return (trace.tree_at(i), trace.states(i), trace.blackboard(i)) if i >= 0 else (trace.tree, {}, {})


def _at(trace: Trace, tick: int, unicode: bool) -> Iterator[str]:
    """The whole tree after a tick."""
    i = trace.index_at(tick)
    tree, _, blackboard = _standing(trace, i)
    states = trace.states_at(tick)
    yield _title(trace, i, WIDTH, tick)
    yield from (line.text for line in tree_lines(tree, states, WIDTH, unicode=unicode))
    yield from filter(None, [where(tree, states, WIDTH), _values(blackboard, (), WIDTH)])
    yield cut(legend(unicode), WIDTH)


def _changes(trace: Trace, unicode: bool) -> Iterator[str]:
    """A line for every change."""
    yield from (line.text for line in tree_lines(trace.tree, None, WIDTH, unicode=unicode))
    placed = {node.path: node for node in trace.tree.nodes}
    for change, moment in trace.moments():
        when = f"{change.time_s:7.1f} s  "
        if change.tree is not None:
            yield cut(f"{when}the tree from now on:", WIDTH)
            yield from (line.text for line in tree_lines(moment.tree, None, WIDTH, unicode=unicode))
            placed = {node.path: node for node in moment.tree.nodes}
        for path in filter(change.nodes.__contains__, placed):
            yield when + node_line(placed[path], change.nodes[path], WIDTH - len(when), unicode=unicode).text
        if change.blackboard:
            yield cut(when + _values(change.blackboard, (), WIDTH), WIDTH)
    yield cut(_ending(trace), WIDTH)


def _ending(trace: Trace) -> str:
    if trace.end is None:
        return "the trace was cut off here: nothing says how the run ended"
    error = f": {one_line(trace.end.error.message)}" if trace.end.error else ""
    return trace.told + error


def _title(trace: Trace, i: int, width: int, tick: int | None = None) -> str:
    """Where in the trace this is: at its change i, or at a tick from then on."""
    last = len(trace.ticks) - 1
    at = "before the first tick"
    here = trace.ticks[i].tick if i >= 0 else 0
    if i >= 0:
        tick = here if tick is None else tick
        at = f"tick {tick}, {trace.time_at(tick):.1f} s"
    ending = f"  {_ending(trace)}" if i == last and tick in (None, here, trace.last_tick) else ""
    return cut(f"{one_line(trace.tree.name)}  change {i + 1} of {last + 1}: {at}{ending}", width)


def _values(values: Mapping[str, Any], changed: Container[str], width: int) -> str:
    """The blackboard on a line, or "" if it is empty; what changed is marked by a star."""
    shown = ", ".join(
        f"{'*' if key in changed else ''}{one_line(key)} = {'-' if value is None else one_line(str(value))}"
        for key, value in values.items()
    )
    return cut(f"blackboard: {shown}", width) if shown else ""


class Player:
    """A trace on a terminal, moved through by keys.

    Args:
        trace: What to show.
        unicode: Draw with lines and signs beyond ASCII.
    """

    def __init__(self, trace: Trace, unicode: bool = False) -> None:
        self._trace, self._unicode = trace, unicode
        self._colored = wants_color(results())
        self.i = min(0, len(trace.ticks) - 1)

    def play(self) -> None:
        """Draw and obey keys until q. The screen is left as it was."""
        keyboard = sys.stdin.fileno()
        before = termios.tcgetattr(keyboard)
        tty.setcbreak(keyboard)  # all the time, unlike click.getchar: keys typed while it draws are not lost
        draw(results(), "\x1b[?1049h\x1b[?25l")  # another screen, no cursor
        try:
            while True:
                screen = "\x1b[K\n".join(self.screen(size()))
                draw(results(), f"\x1b[H{screen}\x1b[K\x1b[J")
                for key in _KEY.findall(os.read(keyboard, 64).decode(errors="replace")) or ["q"]:  # nothing: hung up
                    if key == "q":
                        return
                    self.press(key)
        finally:
            draw(results(), "\x1b[?25h\x1b[?1049l")
            termios.tcsetattr(keyboard, termios.TCSADRAIN, before)

    def press(self, key: str) -> None:
        """Move as a key says: a letter, or the escape sequence that a terminal sends."""
        last = len(self._trace.ticks) - 1
        step = _ESCAPES.get(key, key)
        moves = {"n": 1, "p": -1, "page down": _PAGE, "page up": -_PAGE, "end": last - self.i, "home": -self.i}
        goal = self._next_failure() if step == "f" else self.i + moves.get(step, 0)
        self.i = max(min(goal, last), min(0, last))

    def _next_failure(self) -> int:
        for i in range(self.i + 1, len(self._trace.ticks)):
            if any(state.status == "FAILURE" or state.gave_up for state in self._trace.ticks[i].nodes.values()):
                return i
        return self.i

    def screen(self, size: os.terminal_size) -> list[str]:
        """The lines of the present tick, fitted to the terminal's size."""
        width = min(size.columns, WIDEST)
        trace, i = self._trace, self.i
        tree, states, blackboard = _standing(trace, i)
        change = trace.ticks[i] if i >= 0 else Tick(1, 0.0)
        values = {**dict.fromkeys(change.blackboard), **blackboard}
        below = [where(tree, states, width), _values(values, change.blackboard, width)]
        below = [*filter(None, below), cut(legend(self._unicode), width), cut(_HELP, width)]
        lines = tree_lines(tree, states, width - 2, fold=True, unicode=self._unicode)
        first, last = 0, len(lines)
        if len(lines) > (room := max(size.lines - 1 - len(below), 2)):
            first, last = window(lines, room - 1)
            below.insert(0, cut(left_out(first, last, len(lines)), width))
        shown = [
            ("> " if line.path in change.nodes else "  ") + (painted(line) if self._colored else line.text)
            for line in lines[first:last]
        ]
        return [_title(trace, i, width), *shown, *below][: size.lines]
