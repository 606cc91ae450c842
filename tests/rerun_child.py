"""Runs a search that never ends, logging it to FILE; prints each step once it is logged. A test kills it.

With LIMIT, the system lets no file grow beyond so many bytes, as if the disk were full then.
"""

from __future__ import annotations

import resource
import sys

from mpvi_bt.executive.ticking.loop import Watcher, World, run_episode
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.runs.recording import rerun_log
from mpvi_bt.runs.recording.rerun_log import RerunLog
from mpvi_bt.testing import scripted_context
from tests.search_views import MadeUpSearch, box, find, look
from tests.test_recorders import SKILLS, SPEC, VisibleWorld


class Telling(Watcher):
    """Prints how far it is."""

    def step(self, tree: Tree, world: World) -> None:
        """Which step was just logged."""
        if world.steps % 6 == 0:
            print(world.steps, flush=True)


if __name__ == "__main__":
    search = MadeUpSearch(image=look(1, 2, 0), detections=[box("can", 100, 100, 140, 150)], entries=[find("can", 3, 3)])
    moving = VisibleWorld()
    context = scripted_context(moving, SKILLS, {"trash can": (1.0, 0.0), "can of soda": (0.0, 0.5)}, {})
    log = RerunLog(sys.argv[1], search.map, "endless", search)
    if len(sys.argv) > 2:
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]),) * 2)
        rerun_log._FLUSH_S = 1.0
    while True:
        run_episode(Tree(SPEC), moving, context, [log, Telling()], max_time_s=1e9)
