"""A file with an episode stopped between two ticks. `mpvi run --resume` continues it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import JsonValue, model_validator

from mpvi_bt.executive.ticking.loop import World
from mpvi_bt.executive.ticking.saved_run import SavedRun, save_run
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.executive.tree.yaml_io import expanded, from_expanded
from mpvi_bt.ground.errors import FileProblems, shown
from mpvi_bt.ground.file_kinds import expect
from mpvi_bt.ground.marked_yaml import Record, load_marked, validate_data
from mpvi_bt.ground.robot.protocol import SIDES
from mpvi_bt.ground.version import __version__
from mpvi_bt.runs.choices.config import ALWAYS, RECORDED, SETTINGS, EpisodeConfig
from mpvi_bt.runs.choices.settings import settings_record
from mpvi_bt.runs.episode.metrics import Measurement, Meter
from mpvi_bt.runs.episode.result import write_json

if TYPE_CHECKING:
    from mpvi_bt.runs.choices.world_truth import Audit

FORMAT = 1  # of these files
_FILES = ("task", *(name for name, known in SETTINGS.items() if known.folder is not None))  # what may name one


class SavedSettings(settings_record(RECORDED, required=ALWAYS - {"trigger", "while_asked"})):  # type: ignore[misc]
    """What `EpisodeConfig.record` tells; the first such files told of no trigger and nothing of waiting."""

    arguments: dict[str, str] = {}


class SavedEpisode(Record):
    """How an episode stands.

    Attributes:
        saved: Version of this layout.
        version: Of mpvi_bt.
        folder: In which it was begun: files that `config` names are relative to it.
        config: Of the episode.
        dry: Whether it runs without a robot.
        tree: That is run, its subtrees written out: the files may have changed since.
        measurement: Of the meter so far; None in a dry run.
        truths: Of the audit so far, for each query of the run's log.
        run: Tree, blackboard, log and world.
    """

    saved: int = FORMAT
    version: str
    folder: str = ""
    config: SavedSettings
    dry: bool = False
    tree: dict[str, JsonValue]
    measurement: Measurement | None = None
    truths: list[bool | None] = []
    run: SavedRun

    @model_validator(mode="after")
    def _measured(self) -> SavedEpisode:
        measured = self.measurement
        hands = (measured.hand_world_m, measured.hand_base_m) if measured else ()
        if not self.dry and (not hands or any(set(ways) != set(SIDES) for ways in hands)):
            raise ValueError("an episode with a robot needs its measurement, of both hands")
        return self

    @property
    def episode(self) -> EpisodeConfig:
        """Settings of the saved episode; its files are found from the present folder too."""
        files = {name: self._found(getattr(self.config, name)) for name in _FILES}
        arguments = tuple(self.config.arguments.items())
        return EpisodeConfig(**{**self.config.model_dump(), **files, "arguments": arguments})

    def _found(self, given: str | None) -> str | None:
        """A path in the folder of the first run, if that is another folder and has the file."""
        there = Path(self.folder, given or "")
        return str(there) if given and Path(self.folder) != Path.cwd() and there.is_file() else given

    @property
    def spec(self) -> TreeSpec:
        """The tree. Raises FileProblems if it is none."""
        return from_expanded(self.tree, "the saved tree")


class Keeper:
    """Asks `stop` whether a run is to end before its next tick, and if so first writes it to a file.

    Args:
        stop: Such as `executive.stop.Stop`.
        config: Of the episode; its `saved` names the file, or is None: nothing is written.
        tree, world: That are run.
        meter, audit: Of the episode; None in a dry run.
    """

    def __init__(
        self,
        stop: Callable[[], bool],
        config: EpisodeConfig,
        tree: Tree,
        world: World,
        meter: Meter | None = None,
        audit: Audit | None = None,
    ) -> None:
        self._stop, self._config, self._tree, self._world = stop, config, tree, world
        self._meter, self._audit = meter, audit

    def __call__(self) -> bool:
        """Whether to end now."""
        if not self._stop():
            return False
        if self._config.saved is not None and self._tree.ticks:
            if self._meter is not None:
                self._meter.step(self._tree, self._world)  # the step that was taken since the last tick
            saved = SavedEpisode(
                version=__version__,
                folder=str(Path.cwd()),
                config=SavedSettings(**self._config.record()),
                dry=self._meter is None,
                tree=expanded(self._tree.spec),
                measurement=self._meter.measurement if self._meter else None,
                truths=self._audit.truths if self._audit else [],
                run=save_run(self._tree, self._world),
            )
            write_json(self._config.saved, saved.model_dump(mode="json"))
        return True


def load_saved(path: str | Path) -> SavedEpisode:
    """A stopped episode from its file.

    Raises:
        UserError: There is no such file.
        FileProblems: It is of another format, or everything that is wrong with it.
    """
    data, marks = load_marked(path)
    expect("saved run", data, marks)
    if isinstance(data, dict) and (saved := data.get("saved", FORMAT)) != FORMAT:
        message = f"format {shown(saved)}; this mpvi_bt ({__version__}) reads format {FORMAT}"
        raise FileProblems([marks.problem(("saved",), "invalid-value", message)])
    return validate_data(data, marks, SavedEpisode)
