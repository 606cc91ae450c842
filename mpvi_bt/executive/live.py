"""The tree's status as text while it runs: redrawn in place on a terminal, one line a change when piped."""

from __future__ import annotations

import shutil
import time
from typing import TextIO

from mpvi_bt.executive.loop import Outcome, World
from mpvi_bt.tree.build import Tree
from mpvi_bt.tree.render import LEGEND, ascii_tree, node_line
from mpvi_bt.tree.spec import TreeSpec
from mpvi_bt.tree.state import NodeState

_WIDTH = 80
_REDRAWS_PER_S = 5.0  # Our choice: an eye asks for no more, and each costs about a millisecond


class LiveTree:
    """Subscriber that shows the tree.

    On a terminal nodes that neither run nor failed are folded while it runs, and what still does not fit is cut. Piped,
    the whole tree is printed at the start, and then a line for every node whose status changed. Both end with the
    whole tree.

    Args:
        stream: Where to write.
        title: Above the tree.
    """

    def __init__(self, stream: TextIO, title: str = "") -> None:
        self._stream, self._title = stream, title
        self._terminal = stream.isatty()
        self._height = 0  # lines drawn, to go up before the next drawing
        self._drawn = float("-inf")
        self._seen: list[object] = []
        self._tree: Tree | None = None
        self._shown: TreeSpec | None = None

    def show(self, spec: TreeSpec) -> None:
        """Draw a tree that does not run yet, so that a person sees it while the world is being built."""
        self._shown = spec
        if self._terminal:
            self._redraw(spec, {}, "waiting for the world")
        else:
            self._write(([self._title] if self._title else []) + [ascii_tree(spec, width=_WIDTH)])

    def start(self, tree: Tree, world: World) -> None:
        """Draw the tree, unless `show` has."""
        self._tree = tree
        self._seen = list(tree.statuses())
        if self._shown != tree.spec:
            self.show(tree.spec)

    def step(self, tree: Tree, world: World) -> None:
        """Redraw if it is time to, or print what changed."""
        if self._terminal:
            now = time.monotonic()
            if now - self._drawn >= 1 / _REDRAWS_PER_S:
                self._drawn = now
                self._redraw(tree.spec, tree.states(), f"{world.time_s:.1f} s")
            return
        statuses = tree.statuses()
        if statuses != self._seen:
            states = tree.states()
            changed = [
                f"{world.time_s:7.1f} s  " + node_line(node, states[node.path], _WIDTH - 11)
                for node, old, new in zip(tree.spec.nodes, self._seen, statuses, strict=True)
                if old != new
            ]
            self._seen = list(statuses)
            self._write(changed)

    def end(self, outcome: Outcome) -> None:
        """Draw the last state, which stays."""
        if self._tree is None:
            return
        states = self._tree.states()
        how = f"{outcome.ending.replace('_', ' ')} after {outcome.time_s:.1f} s"
        if self._terminal:
            self._redraw(self._tree.spec, states, how, whole=True)
        else:
            self._write([ascii_tree(self._tree.spec, states, _WIDTH), how])

    def _redraw(self, spec: TreeSpec, states: dict[str, NodeState], status: str, whole: bool = False) -> None:
        size = shutil.get_terminal_size((_WIDTH, 24))
        width = min(size.columns, _WIDTH)
        head = f"{self._title}  {status}" if self._title else status
        lines = [head[:width], *ascii_tree(spec, states, width, fold=not whole).splitlines(), LEGEND[:width]]
        room = max(size.lines - 1, 3)
        if len(lines) > room and not whole:
            lines = [*lines[: room - 1], f"... {len(lines) - room + 1} more lines"]
        up = f"\x1b[{self._height}F" if self._height else ""
        self._stream.write(up + "".join(line + "\x1b[K\n" for line in lines) + "\x1b[J")
        self._stream.flush()
        self._height = len(lines)

    def _write(self, lines: list[str]) -> None:
        self._stream.write("".join(line + "\n" for line in lines))
        self._stream.flush()
