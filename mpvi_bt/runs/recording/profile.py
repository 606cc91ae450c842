"""Where an episode's wall time goes: a table by what the robot did, and a flame graph. Only here is pyinstrument."""

from __future__ import annotations

import importlib.util
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING

from py_trees.common import Status

from mpvi_bt.executive.behaviors.navigate import Navigate
from mpvi_bt.executive.ticking.loop import Outcome, Watcher, World
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.ground.compiled import compiling
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.extras import install
from mpvi_bt.ground.writing import write_whole

if TYPE_CHECKING:
    from pyinstrument.session import Session

_EVERY_S = 0.005  # Our choice: an episode of a minute has some 10,000 stacks, which are 5 MB
SETUP, DRIVE, MANIPULATE, OTHER = "setting up", "drive", "manipulate", "other"
REST = "simulator and tree"


def require_profiler() -> None:
    """Raises UserError unless the profiler is installed."""
    if importlib.util.find_spec("pyinstrument") is None:
        raise UserError(f"--profile needs the package pyinstrument: {install('profile')}")


class Profile(Watcher):
    """Samples the stack of this thread from now on, and writes it for https://speedscope.app at the end.

    Attributes:
        seconds: Wall time [s] by what the robot did, and of that by activity, as the episode's `wall_s` names them.
            What the robot did is the skill that the policy says it carries out, "drive", "manipulate" of a policy that
            names no skill, or "other". A step of the simulator counts to the tick after it.
    """

    def __init__(self, file: Path) -> None:
        """Begin.

        Args:
            file: Where to write.
        """
        from pyinstrument import Profiler

        self._file = file
        self._before: dict[str, float] = {}
        self.seconds: dict[str, dict[str, float]] = {}
        self._since_s, self._compiled_s = compiling.clock(), compiling.seconds
        self._profiler = Profiler(_EVERY_S, async_mode="disabled")
        self._profiler.start()

    def start(self, tree: Tree, world: World) -> None:
        """Count what came before as setting up."""
        self._count(SETUP, {})

    def step(self, tree: Tree, world: World) -> None:
        """Count the time since the last tick to what the robot does."""
        self._count(_doing(tree), tree.context.stopwatch.seconds)

    def end(self, outcome: Outcome) -> None:
        """Write the file."""
        if (compiled_s := compiling.seconds - self._compiled_s) > 0:
            self.seconds["compiling"] = {REST: compiled_s}
        write_whole(self._file, _speedscope(self._profiler.stop()))

    def _count(self, doing: str, stopwatch: dict[str, float]) -> None:
        now = compiling.clock()
        spent = {name: seconds - self._before.get(name, 0.0) for name, seconds in stopwatch.items()}
        spent[REST] = now - self._since_s - sum(spent.values())
        row = defaultdict(float, self.seconds.get(doing, {}))
        for name, seconds in spent.items():
            if seconds:
                row[name] += seconds
        self.seconds[doing] = dict(row)
        self._since_s, self._before = now, dict(stopwatch)


def _doing(tree: Tree) -> str:
    context = tree.context
    if context.log.under_way:
        said = str(getattr(context.policy, "note", "")).partition(":")[0]
        return said if said in context.skills else MANIPULATE
    drives = (node.status is Status.RUNNING for node in tree.touched if isinstance(node, Navigate))
    return DRIVE if any(drives) else OTHER


def _speedscope(session: Session) -> str:
    from pyinstrument.renderers import SpeedscopeRenderer

    every_call = {"filter_threshold": 0.0}  # else what takes less than a hundredth at once is left out, however often
    return str(SpeedscopeRenderer(processor_options=every_call).render(session))
