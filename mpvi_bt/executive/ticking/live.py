"""The tree's status as text while it runs: redrawn in place on a terminal, one line a change when piped."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterable
from typing import TextIO

from mpvi_bt.executive.drawing.cells import WIDTH, cut, one_line
from mpvi_bt.executive.drawing.colors import obeys_escapes, painted, wants_color
from mpvi_bt.executive.drawing.symbols import legend
from mpvi_bt.executive.drawing.terminal import draw
from mpvi_bt.executive.drawing.terminal import size as terminal_size
from mpvi_bt.executive.drawing.text import left_out, node_line, tree_lines, where, window
from mpvi_bt.executive.ticking.loop import Outcome, World
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.executive.tree.state import NodeState

_REDRAWS_PER_S = 5.0  # Our choice: an eye asks for no more, and each costs about a millisecond


class LiveTree:
    """Subscriber that shows the tree.

    On a terminal nodes that neither run nor failed are folded while it runs, and of what still does not fit, the part
    about the running node is shown. Piped, the whole tree is printed at the start, and then a line for every node whose
    status changed. Both end with the whole tree and the node that failed it.

    Args:
        stream: Where to write.
        title: Above the tree.
        unicode: Draw with lines and signs beyond ASCII.
        redraw: False: on a terminal too, as piped; for one on which others write as well.
    """

    def __init__(self, stream: TextIO, title: str = "", unicode: bool = False, redraw: bool = True) -> None:
        self._stream, self._title, self._unicode = stream, one_line(title), unicode
        self._terminal = redraw and stream.isatty() and obeys_escapes()
        self._colored = wants_color(stream)
        self._height = 0  # lines drawn, to go up before the next drawing
        self._drawn = float("-inf")
        self._seen: dict[str, str] = {}  # statuses as last printed
        self._tree: Tree | None = None
        self._shown: TreeSpec | None = None

    def show(self, spec: TreeSpec) -> None:
        """Draw a tree before it runs, so that a person sees it while the world is built."""
        self._shown = spec
        if self._terminal:
            self._redraw(spec, {}, "waiting for the world")
        else:
            lines = [line.text for line in tree_lines(spec, None, WIDTH, unicode=self._unicode)]
            self._write([cut(self._title, WIDTH), *lines] if self._title else lines)

    def wait(self, what: str) -> None:
        """Show the reason for waiting: in place of the time, or as a line of its own if piped."""
        if self._terminal and self._shown is not None:
            self._redraw(self._shown, self._tree.states() if self._tree else {}, what)
        else:
            self._write([what])

    def start(self, tree: Tree, world: World) -> None:
        """Draw the tree, unless `show` has."""
        self._tree = tree
        if self._shown != tree.spec:
            self.show(tree.spec)
        self._shown = tree.spec

    def step(self, tree: Tree, world: World) -> None:
        """Redraw if it is time to, or print what changed."""
        if self._terminal:
            now = time.monotonic()
            if now - self._drawn >= 1 / _REDRAWS_PER_S:
                self._drawn = now
                self._redraw(tree.spec, tree.states(), f"{world.time_s:.1f} s")
            return
        if self._shown is not tree.spec:  # a part was swapped
            self.show(tree.spec)
        changed: dict[str, NodeState] = {}
        for node in tree.touched:
            path, status = str(vars(node)["path"]), node.status.value
            if status != self._seen.get(path, "INVALID"):
                self._seen[path] = status
                changed[path] = tree.state_of(node)
        if changed:
            self._write(
                f"{world.time_s:7.1f} s  "
                + node_line(placed, changed[placed.path], WIDTH - 11, unicode=self._unicode).text
                for placed in tree.spec.nodes
                if placed.path in changed
            )

    def end(self, outcome: Outcome) -> None:
        """Draw the last state, which stays."""
        if self._tree is None:
            return
        spec, states = self._tree.spec, self._tree.states()
        how = outcome.told(spec)
        if self._terminal:
            self._redraw(spec, states, how, whole=True)
        else:
            lines = [line.text for line in tree_lines(spec, states, WIDTH, unicode=self._unicode)]
            self._write([*lines, *filter(None, [where(spec, states, WIDTH)]), how])

    def _redraw(self, spec: TreeSpec, states: dict[str, NodeState], status: str, whole: bool = False) -> None:
        size = terminal_size()
        width = min(size.columns, WIDTH)
        head = f"{self._title}  {status}" if self._title else status
        below = [*filter(None, [where(spec, states, width)]), cut(legend(self._unicode), width)]
        lines = tree_lines(spec, states, width, fold=not whole, unicode=self._unicode)
        first, last = 0, len(lines)
        if not whole and len(lines) > (room := max(size.lines - 2 - len(below), 2)):
            first, last = window(lines, room - 1)
            below.insert(0, cut(left_out(first, last, len(lines)), width))
        drawn = [
            cut(head, width),
            *(painted(line) if self._colored else line.text for line in lines[first:last]),
            *below,
        ]
        up = f"\x1b[{self._height}F" if self._height else ""
        self._print(up + "".join(line + "\x1b[K\n" for line in drawn) + "\x1b[J")
        self._height = len(drawn)

    def _write(self, lines: Iterable[str]) -> None:
        self._print("".join(line + "\n" for line in lines))

    def _print(self, text: str) -> None:
        with contextlib.suppress(OSError):  # full, or nobody reads it any more: that is no reason to end a run
            draw(self._stream, text)
