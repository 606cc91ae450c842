"""Pauses an episode for a person to look at, and asks how to go on.

It watches and may block, but never steers: what it does to an episode is what Ctrl-C does.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterable
from typing import Literal, NoReturn, Protocol

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from mpvi_bt.executive.behaviors.context import Failure
from mpvi_bt.executive.drawing.cells import WIDTH, wrapped
from mpvi_bt.executive.drawing.text import ascii_tree
from mpvi_bt.executive.ticking.loop import Watcher, World
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.globs import matching, require_match
from mpvi_bt.ground.errors import UserError

_STOP = "q\n"
_WORDS = {
    Status.SUCCESS: "success",
    Status.FAILURE: "failure",
    Status.RUNNING: "running",
    Status.INVALID: "reset",
}
_HELP = """\
  Enter, n  go on to the next change     s  show the tree
  t         go on to the next tick       k  show the blackboard
  c         go on to the next break      e  show the failures so far
  b PATH    break where such a node begins; * is any text
  q         stop the episode, as Ctrl-C  h  show this
"""


class AnswerSource(Protocol):
    """Where answers come from, such as a terminal."""

    def readline(self) -> str:
        """The next one; "": there are no more."""
        ...

    def isatty(self) -> bool:
        """Whether it shows itself what is typed."""
        ...


class Stream(Protocol):
    """Where questions go."""

    def write(self, text: str, /) -> object:
        """Take in text."""
        ...

    def flush(self) -> object:
        """Show it."""
        ...


def interrupt() -> NoReturn:
    """Do as Ctrl-C."""
    raise KeyboardInterrupt


class Debugger(Watcher):
    """Subscriber that pauses after a tick and before the world moves, and reads a line of input.

    A node begins in a tick in which it turns RUNNING, or ends without having been RUNNING before. A change is one of a
    node's status or of the blackboard. Once the input has ended nothing pauses any more.

    Attributes:
        news: Why it pauses, or paused last: when, and what changed, a line each.

    Args:
        source: Where the answers come from.
        stream: Where the questions go.
        breaks: Globs over paths; it pauses where such a node begins.
        step: Whether it pauses at every change from the start.
        stop: What ends the episode.

    Raises at `start`:
        UserError: A break fits no node.
    """

    def __init__(
        self,
        source: AnswerSource,
        stream: Stream,
        breaks: Iterable[str] = (),
        step: bool = False,
        stop: Callable[[], object] = interrupt,
    ) -> None:
        self._source, self._stream, self._stop = source, stream, stop
        self._breaks = list(breaks)
        self._until: Literal["tick", "change", "break", "end"] = "change" if step else "break"
        self._paths: set[str] = set()  # of the breaks
        self._seen: dict[Behaviour, Status] = {}
        self._blackboard: dict[str, object] = {}
        self._greeted = False
        self.news: tuple[str, ...] = ()

    def start(self, tree: Tree, world: World) -> None:
        """Find the nodes to break at. Raises UserError if a break fits none."""
        self._blackboard = dict(tree.spec.blackboard)
        self._paths = {path for glob in self._breaks for path in require_match(glob, tree.spec, "--break")}
        self._spec = tree.spec

    def pause(self) -> None:
        """Pause at the next tick; any thread may say so."""
        if self._until != "end":
            self._until = "tick"

    def break_at(self, glob: str) -> list[str]:
        """Break where such a node begins, too; any thread may say so. Raises UserError if it fits none."""
        paths = require_match(glob, self._spec, "b")
        self._breaks = [*self._breaks, glob]
        self._paths = {*self._paths, *paths}
        return paths

    def step(self, tree: Tree, world: World) -> None:
        """Pause if it is time to."""
        if not self._seen and tree.ticks > 1:  # it goes on from where it was saved: nothing of that begins now
            self._seen = {node: node.status for node in tree.nodes.values()}
        if tree.spec is not self._spec:  # a part was swapped: the breaks are for it as well
            self._spec = tree.spec
            self._paths |= {path for glob in self._breaks for path in matching(glob, tree.spec)}
        if self._until == "end":
            return
        begun, changed = self._look(tree)
        here = [path for path in begun if path in self._paths]
        if not (here or self._until == "tick" or (self._until == "change" and changed)):
            return
        count = f"{len(changed)} change{'s' * (len(changed) > 1)}" if changed else "nothing changed"
        news = [f"break at {path}" for path in here] or [count, *changed]
        self.news = (f"tick {tree.ticks}, {world.time_s:.1f} s: {news[0]}", *news[1:])
        self._say(*self.news)
        with tree.context.stopwatch("paused"):
            self._ask(tree)

    def _look(self, tree: Tree) -> tuple[list[str], list[str]]:
        """Paths of the nodes begun in this tick, and its changes, for a person."""
        begun, changed = [], []
        for node in dict.fromkeys(tree.touched):
            path, now, before = str(vars(node)["path"]), node.status, self._seen.get(node, Status.INVALID)
            if before != Status.RUNNING and (now != Status.INVALID or before == Status.INVALID):
                begun.append(path)
            if now != before:
                self._seen[node] = now
                cut_off = now == Status.INVALID and getattr(node, "interrupted", False)
                changed.append(f"{'interrupted' if cut_off else _WORDS[now]:12}{path}")
        if tree.context.blackboard != self._blackboard:
            self._blackboard = dict(tree.context.blackboard)
            changed.append("blackboard")
        return begun, changed

    def _ask(self, tree: Tree) -> None:
        """Answer until one says to go on."""
        if not self._greeted:
            self._greeted = True
            self._stream.write(_HELP)
        while True:
            self._stream.write("debug> ")
            self._stream.flush()
            line = self._line()
            if not line:
                self._until = "end"
                self._say("no more input: going on to the end")
                return
            if not self._source.isatty() or line == _STOP:  # a terminal has shown all else already
                self._stream.write(line.rstrip("\n") + "\n")
            if self._answer(tree, line.strip()):
                return

    def _line(self) -> str:
        """The typed line. Ctrl-C means stop, at once."""
        if threading.current_thread() is not threading.main_thread():
            return self._source.readline()
        before = signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            return self._source.readline()
        except KeyboardInterrupt:
            return _STOP
        finally:
            signal.signal(signal.SIGINT, before)

    def _answer(self, tree: Tree, line: str) -> bool:
        """Do what a line says; whether to go on."""
        word, _, rest = line.partition(" ")
        match word:
            case "" | "n":
                self._until = "change"
                return True
            case "t":
                self._until = "tick"
                return True
            case "c":
                self._until = "break"
                return True
            case "q":
                self._until = "end"
                self._stop()
                return True
            case "b" if rest.strip():
                try:
                    self._say(*(f"breaks at {path}" for path in self.break_at(rest.strip())))
                except UserError as error:
                    self._say(str(error))
            case "s":
                self._stream.write(ascii_tree(tree.spec, tree.states(), WIDTH) + "\n")
            case "k":
                values = sorted(tree.context.blackboard.items())
                self._say(*(f"{key} = {value!r}" for key, value in values) if values else ("the blackboard is empty",))
            case "e":
                failures = _failures(tree)
                lines = (f"{f.time_s:.1f} s: {f.path}: {f.reason}: {f.evidence}" for f in failures)
                self._say(*lines if failures else ("no failure so far",))
            case _:
                self._stream.write(_HELP)
        return False

    def _say(self, *lines: str) -> None:
        self._stream.write("".join(part + "\n" for line in lines for part in wrapped(line, WIDTH)))
        self._stream.flush()


def _failures(tree: Tree) -> list[Failure]:
    """Recorded failures and those of nodes that stand failed now, each once, in the order of time."""
    standing = (getattr(node, "failure", None) for node in tree.nodes.values() if node.status == Status.FAILURE)
    found = [*tree.context.log.failures, *(failure for failure in standing if failure is not None)]
    return sorted(dict.fromkeys(found), key=lambda failure: failure.time_s)
