"""A cache of drawn and checked starts in the user's folder, to save time.

A file's name tells all that its start depends on. What cannot be read, is cut short or does not fit is as good as not
there; what cannot be written is not kept.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import MpviError
from mpvi_bt.ground.marked_yaml import Record
from mpvi_bt.ground.writing import write_whole
from mpvi_bt.house.generated.seeded_name import seeded
from mpvi_bt.house.goals.problem import BddlProblem
from mpvi_bt.house.instances import sampling
from mpvi_bt.house.instances.sampling import Start, marks_of, scene_names
from mpvi_bt.house.instances.splits import Split, hidden_seed
from mpvi_bt.house.instances.tasks import Task
from mpvi_bt.house.layout import arranging, boards, ground
from mpvi_bt.house.layout.house import House
from mpvi_bt.house.sim.future import future
from mpvi_bt.house.sim.world import Placement
from mpvi_bt.house.states.relations import kind_of
from mpvi_bt.house.things.catalogue import Catalogue
from mpvi_bt.house.things.description import Description

FORMAT = 1
_MAX_BYTES = 1_000_000
_FARTHEST_M = 1000.0
_SAMPLER = (arranging, boards, ground, sampling)  # whose text is its version


class KeptStart(Record):
    """A start as it stands in the file; poses are the rows of (4, 4), one after the other."""

    start: int
    objects: dict[str, list[float]]
    base_pose: tuple[float, float, float]
    openings: dict[str, dict[str, float]]
    on: tuple[str, ...]


class StartCache:
    """Where the start of one instance is kept.

    Args:
        task, house, catalogue, problem, instance, split: As of `instances.begin`.
    """

    def __init__(
        self, task: Task, house: House, catalogue: Catalogue, problem: BddlProblem, instance: int, split: Split
    ) -> None:
        self._task, self._house, self._catalogue, self._problem = task, house, catalogue, problem
        parts = [
            repr(FORMAT),
            version("sapien"),
            split,
            repr(instance),
            repr(problem),
            repr(sorted(task.bindings.items())),
        ]
        parts += [Path(str(module.__file__)).read_text(encoding="utf-8") for module in _SAMPLER]
        if split == "hidden":
            parts.append(hidden_seed())
        digest = hashlib.sha256("\0".join(parts).encode())
        for text in _geometry(house, catalogue, task):
            digest.update(text)
        own = "" if seeded(house.name) is None else f"_{house.name}"
        self._stem = f"{task.problem}_{split}_{instance}{own}"
        self._name = f"{self._stem}-{digest.hexdigest()[:24]}.json"

    def load(self) -> Start | None:
        """The start, if one is kept that fits the problem."""
        for home in paths.caches():
            path = home / "starts" / self._name
            try:
                if path.stat().st_size > _MAX_BYTES:
                    continue
                kept = KeptStart.model_validate(json.loads(path.read_bytes()))
                return self._start(kept)
            except (OSError, ValueError, ValidationError, RecursionError):
                continue
        return None

    def save(self, start: Start) -> None:
        """Keep a start, instead of those of the same instance that were drawn otherwise."""
        kept = KeptStart(
            start=FORMAT,
            objects={name: placement.T_world.ravel().tolist() for name, placement in start.objects.items()},
            base_pose=(float(start.base_pose[0]), float(start.base_pose[1]), float(start.base_pose[2])),
            openings={name: dict(bodies) for name, bodies in start.openings.items()},
            on=start.on,
        )
        for home in paths.caches():
            folder = home / "starts"
            try:
                folder.mkdir(mode=0o700, parents=True, exist_ok=True)
                write_whole(folder / self._name, json.dumps(kept.model_dump(mode="json")))
                for other in folder.glob(f"{self._stem}-*.json"):
                    if other.name != self._name:
                        other.unlink(missing_ok=True)
                return
            except (OSError, MpviError):
                continue

    def _start(self, kept: KeptStart) -> Start:
        """Raises ValueError if it is not of this problem."""
        poses = {name: np.array(T, float) for name, T in kept.objects.items()}
        fit = all(T.shape == (16,) and (np.abs(T) < _FARTHEST_M).all() for T in poses.values())
        more = {kind_of(name) for name in poses.keys() - set(self._problem.bound)}
        others = more - {kind_of(substance) for substance in self._problem.poured}
        if kept.start != FORMAT or not poses.keys() >= set(self._problem.bound) or others or not fit:
            raise ValueError("a start of another problem")
        entries = {name: self._catalogue[self._task.bindings[kind_of(name)]] for name in kept.objects}
        objects = {name: Placement(entry, poses[name].reshape(4, 4)) for name, entry in entries.items()}
        names = scene_names(self._house, self._problem)
        marks = marks_of(self._problem, names)
        later = future(self._catalogue, entries)
        return Start(objects, np.array(kept.base_pose), names, kept.openings, kept.on, marks, later)


def _geometry(house: House, catalogue: Catalogue, task: Task) -> Iterator[bytes]:
    """All shapes and places that a start depends on, as bytes."""
    for wall in house.walls:
        yield wall.solid.half_m.tobytes() + wall.solid.T.tobytes()
    for fixture in house.fixtures.values():
        yield fixture.name.encode() + fixture.T_world_fixture.tobytes()
        yield from _form(fixture.entry.description)
    for name in sorted(set(task.bindings.values())):
        entry = catalogue[name]
        yield repr((name, entry.mass_kg, entry.friction, entry.rolling_damping, entry.at_back)).encode()
        yield from _form(entry.description)


def _form(description: Description) -> Iterator[bytes]:
    for body in description.bodies:
        yield repr((body.name, body.joint.limit if body.joint else None, len(body.handles))).encode()
        yield body.frame().tobytes()
        for solid in (*(part.solid for part in body.parts if part.collides), *body.volumes):
            yield solid.kind.encode() + solid.half_m.tobytes() + solid.T.tobytes()
        for part in body.parts:
            if part.hull is not None:
                yield part.hull.tobytes()
