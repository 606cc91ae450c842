"""An episode that was stopped between two ticks, as a file, from which `mpvi run --resume` goes on."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from pydantic import JsonValue

from mpvi_bt import __version__
from mpvi_bt.executive.loop import World
from mpvi_bt.executive.saved import SavedRun, save_run
from mpvi_bt.marked_yaml import Record, validate
from mpvi_bt.suite.metrics import Measurement
from mpvi_bt.suite.result import write_json
from mpvi_bt.tree.build import Tree
from mpvi_bt.tree.spec import TreeSpec
from mpvi_bt.tree.yaml_io import expanded, from_expanded


class SavedEpisode(Record):
    """How an episode stands.

    Attributes:
        saved: Version of this layout.
        version: Of mpvi_bt.
        config: Of the episode.
        tree: That is run, its subtrees written out: the files may have changed since.
        measurement: Of the meter so far.
        run: Tree, blackboard, log and world.
    """

    saved: Literal[1] = 1
    version: str
    config: dict[str, JsonValue]
    tree: dict[str, JsonValue]
    measurement: Measurement
    run: SavedRun

    @property
    def spec(self) -> TreeSpec:
        """The tree. Raises FileProblems if it is none."""
        return from_expanded(self.tree, "the saved tree")


def save_episode(config: dict[str, Any], tree: Tree, world: World, measurement: Measurement) -> SavedEpisode:
    """How an episode stands between two ticks."""
    return SavedEpisode(
        version=__version__,
        config=config,
        tree=expanded(tree.spec),
        measurement=measurement,
        run=save_run(tree, world),
    )


def write_saved(path: Path, saved: SavedEpisode) -> None:
    """Write it so that the file is whole or not there, whatever happens."""
    write_json(path, saved.model_dump(mode="json"))


def load_saved(path: str | Path) -> SavedEpisode:
    """A stopped episode from its file.

    Raises:
        UserError: There is no such file.
        FileProblems: Everything that is wrong with it.
    """
    return validate(path, SavedEpisode)
