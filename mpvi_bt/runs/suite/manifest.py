"""A file beside a suite's results describes them, so that results of other settings are not mixed in."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, JsonValue, ValidationError, model_validator

from mpvi_bt.executive.remote.dialect_settings import load_settings
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import UserError, shown
from mpvi_bt.ground.marked_yaml import Record, load_marked
from mpvi_bt.ground.version import __version__
from mpvi_bt.house.generated.generator import generated_house
from mpvi_bt.house.generated.seeded_name import seeded
from mpvi_bt.house.goals.problem import activities
from mpvi_bt.house.instances.splits import hidden_seed
from mpvi_bt.house.instances.tasks import Task, load_task
from mpvi_bt.house.layout.house import load_house
from mpvi_bt.house.things.catalogue import CatalogueEntry, load_catalogue
from mpvi_bt.runs.choices.config import SETTINGS, EpisodeConfig
from mpvi_bt.runs.episode.result import write_json

FILE = "manifest.json"
_MOST = 4  # differences that a message shows
_EPISODES_OWN = ("task", "house", "instance", "seed", "method")


class Manifest(Record):
    """What a suite's results are of.

    Attributes:
        manifest: Version of this layout.
        version, bddl: Of mpvi_bt, and of the distribution that problems come from.
        suite, about: Its name, and its line for people.
        tasks, houses, instances, seeds: Its lists, as last run: more may be added. A house of null is the task's own.
        methods: Settings of every method by its name; "" where the suite names none.
        files: Digest of all data that the episodes read, by its name below a root.
    """

    manifest: Literal[1] = 1
    version: str
    bddl: str
    suite: str
    about: str = ""
    tasks: list[str]
    houses: list[str | None] = [None]
    instances: list[int]
    seeds: list[int]
    methods: dict[Annotated[str, Field(pattern=r"^([^./\x00][^/\x00]*)?$")], dict[str, JsonValue]]
    files: dict[str, str]

    @model_validator(mode="after")
    def _names_settings(self) -> Manifest:
        """Raises ValueError if its methods have settings that no episode has."""
        try:
            for settings in self.methods.values():
                EpisodeConfig("", **_fields(settings))
        except (TypeError, AttributeError) as error:
            raise ValueError(str(error)) from None
        return self

    def episodes(self) -> list[EpisodeConfig]:
        """Every episode, instances running fastest."""
        return [
            EpisodeConfig(task, instance, seed, method=method or None, **{"house": house, **_fields(settings)})
            for method, settings in self.methods.items()
            for task in self.tasks
            for house in self.houses
            for seed in self.seeds
            for instance in self.instances
        ]

    def differences(self, now: Manifest) -> Iterator[str]:
        """Why results of `now` must not stand beside those of this one."""
        for what in ("version", "bddl", "suite"):
            if (was := getattr(self, what)) != (is_ := getattr(now, what)):
                yield f"{what} was {was}, is {is_}"
        for method in self.methods.keys() & now.methods.keys():
            old, new = self.methods[method], now.methods[method]
            of = f" of {method}" if method else ""
            for key in sorted(old.keys() | new.keys()):
                if old.get(key) != new.get(key):
                    yield f"{key}{of} was {_said(old.get(key))}, is {_said(new.get(key))}"
        yield from (
            f"{name} has changed"
            for name in sorted(self.files.keys() & now.files.keys())
            if self.files[name] != now.files[name]
        )

    def claim(self, folder: Path) -> None:
        """Write this manifest to a folder without one, or with an equal one.

        Raises:
            UserError: The folder's results are of something else; or it cannot be written.
            DiskFull: There is no room.
        """
        kept = read_manifest(folder)
        if kept is None:
            return write_json(folder / FILE, self.model_dump())
        if found := list(kept.differences(self)):
            more = f"; and {len(found) - _MOST} more" if len(found) > _MOST else ""
            raise UserError(
                f"{folder}: holds results of something else: {'; '.join(found[:_MOST])}{more}; choose another --out"
            )
        both = self.model_copy(
            update={"methods": {**kept.methods, **self.methods}, "files": {**kept.files, **self.files}}
        )
        if both != kept:
            write_json(folder / FILE, both.model_dump())
        return None


def make_manifest(suite: str, episodes: Sequence[EpisodeConfig], about: str = "") -> Manifest:
    """The manifest of a suite's episodes. Raises as `load_task`."""
    methods: dict[str, dict[str, Any]] = {}
    for config in episodes:
        methods.setdefault(
            config.method or "", {key: value for key, value in config.record().items() if key not in _EPISODES_OWN}
        )
    return Manifest(
        version=__version__,
        bddl=metadata.version("bddl"),
        suite=suite,
        about=about,
        tasks=list(dict.fromkeys(config.task for config in episodes)),
        houses=list(dict.fromkeys(config.house for config in episodes)),
        instances=list(dict.fromkeys(config.instance for config in episodes)),
        seeds=list(dict.fromkeys(config.seed for config in episodes)),
        methods=methods,
        files=digests(episodes),
    )


def read_manifest(folder: Path) -> Manifest | None:
    """The manifest of a folder; None: it has none.

    Raises:
        UserError: It cannot be read, or is none.
    """
    path = folder / FILE
    try:
        if path.exists() and not path.is_file():  # a pipe, say, which nobody may ever write to
            raise UserError(f"{path}: is no file; choose another --out")
        return Manifest.model_validate_json(path.read_bytes())
    except FileNotFoundError:
        return None
    except OSError as error:
        raise UserError(f"{path}: {(error.strerror or 'cannot be read').lower()}") from None
    except ValidationError:
        raise UserError(f"{path}: is not what a suite of this version wrote; choose another --out") from None


def digests(episodes: Sequence[EpisodeConfig]) -> dict[str, str]:
    """A digest of everything of data that the episodes read, by its name below a root; comments do not count.

    Of the catalogue only the entries that are used count, so that it may grow. The secret of hidden instances has one
    that is slow to make, so that nobody finds it by trying.

    Raises:
        UserError: As `load_task`.
    """
    kinds = {(c.task, c.method, c.house): c for c in episodes}.values()
    tasks = {name: load_task(name) for name in dict.fromkeys(c.task for c in episodes)}
    read = {path for config in kinds for path in _files(config, tasks[config.task])}
    read |= {paths.find("skills", name) for name in paths.names("skills")}
    found = {_name(path): _digest(path) for path in sorted(read)}
    catalogue = load_catalogue()
    used = {entry for task in tasks.values() for entry in task.bindings.values()}
    for house in dict.fromkeys(c.house or tasks[c.task].house for c in kinds):
        if (drawn := seeded(house)) is not None:
            found[f"house {house}"] = _hash(generated_house(drawn.seed, kind=drawn.kind))
        used |= {fixture.entry.name for fixture in load_house(house, catalogue).fixtures.values()}
    if any(config.split == "hidden" for config in episodes):
        found["hidden seed"] = hashlib.scrypt(
            hidden_seed().encode(), salt=b"manifest", n=1 << 14, r=8, p=1, dklen=8
        ).hex()
    return found | {f"catalogue entry {name}": _hash(entry_content(catalogue[name])) for name in sorted(used)}


def entry_content(entry: CatalogueEntry) -> dict[str, Any]:
    """The content of a catalogue entry. For a mesh file it has a hash, not the path."""
    told = entry.model_dump()
    if file := entry.shape.get("file"):
        told["shape"] = {**entry.shape, "file": hashlib.sha256(Path(file).read_bytes()).hexdigest()}
    return told


def _files(config: EpisodeConfig, task: Task) -> Iterator[Path]:
    yield paths.find_or_file("tasks", config.task)
    yield activities()[task.problem]
    if seeded(house := config.house or task.house) is None:
        yield paths.find_or_file("tasks/houses", house)
    if plan := config.plan or task.plan:
        yield paths.find_or_file("tasks/plans", plan)
    if tree := config.tree or task.tree:
        yield paths.find_or_file("trees", tree)
    for name in ("unit", "calibration", "substitute", "policy_settings"):
        if given := getattr(config, name):
            yield paths.find_or_file(SETTINGS[name].folder or "", given)
    if config.policy_settings:
        observation = load_settings(config.policy_settings).observation
        if observation is not None and observation.prompts is not None:
            yield Path(observation.prompts)


def _digest(path: Path) -> str:
    return _hash(load_marked(path)[0] if path.suffix in paths.SUFFIXES else path.read_text(encoding="utf-8"))


def _hash(data: Any) -> str:
    return hashlib.sha256(json.dumps(data, sort_keys=True, default=str).encode()).hexdigest()[:16]


def _name(path: Path) -> str:
    """The path relative to its root; the full path if it is under no root."""
    for root in (Path(str(metadata.distribution("bddl").locate_file(""))), *paths.roots()):
        if path.resolve().is_relative_to(root.resolve()):
            return path.resolve().relative_to(root.resolve()).as_posix()
    return str(path)


def _fields(settings: Mapping[str, Any]) -> dict[str, Any]:
    return {**settings, "arguments": tuple(settings.get("arguments", {}).items())}


def _said(value: Any) -> str:
    return value if isinstance(value, str) else shown(value)
