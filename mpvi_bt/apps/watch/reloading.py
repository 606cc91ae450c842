"""Takes the new text of a tree's file into the watched run when its page asks for it."""

from __future__ import annotations

from collections.abc import Callable

from mpvi_bt.apps.watch.channel import Page
from mpvi_bt.executive.ticking.loop import Watcher, World
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.executive.tree.updating import Updated, update
from mpvi_bt.ground.errors import MpviError


class Reloading(Watcher):
    """Subscriber that swaps changed nodes between two ticks. While nobody asks, a step costs one comparison.

    Args:
        page: Which asks, and is told what came of it.
        read: Reads and checks the tree again, as before the run.
    """

    def __init__(self, page: Page, read: Callable[[], TreeSpec]) -> None:
        self._page, self._read = page, read

    def step(self, tree: Tree, world: World) -> None:
        """Take it, if the page asks."""
        if not self._page.reloads:
            return
        self._page.reloads = False
        try:
            said = _told(update(tree, self._read()))
        except MpviError as error:
            said = f"not taken: {error}"
        self._page.send({"reloaded": said})


def _told(updated: Updated) -> str:
    if not updated.changed:
        return "nothing in it has changed"
    parts = [path + (", which ran and begins anew" if path in updated.interrupted else "") for path in updated.changed]
    return "taken: " + "; ".join(parts)
