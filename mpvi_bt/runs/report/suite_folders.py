"""Results of one or more folders side by side: a row for each method, under its own name."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import UnknownName, UserError
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.result import Result
from mpvi_bt.runs.report.runs import Runs, runs_of
from mpvi_bt.runs.suite.manifest import FILE as MANIFEST
from mpvi_bt.runs.suite.manifest import Manifest, read_manifest
from mpvi_bt.runs.suite.store import RUNS, Fault, Store
from mpvi_bt.runs.suite.suites import FOLDER, load_suite

_MOST = 4  # files or folders that a note names


@dataclass(frozen=True)
class SuiteFolder:
    """The results in one folder.

    Attributes:
        suite: Its name.
        store: The folder.
        episodes: All of the suite, in order.
        results: Those that are there.
        faults: What broke others.
        about: The suite, in one line.
    """

    suite: str
    store: Store
    episodes: Sequence[EpisodeConfig]
    results: Mapping[EpisodeConfig, Result]
    faults: Mapping[EpisodeConfig, Fault]
    about: str = ""

    @classmethod
    def named(cls, name: str, out: Path | None = None) -> SuiteFolder:
        """The results that a person means. A folder knows its suite; the suite's file need not be there any more.

        Args:
            name: The folder; or the suite, by its name or its file.
            out: The folder, beside the suite; None: where `mpvi suite run` puts it.

        Raises:
            UserError: There is no such folder or suite, or the folder does not say what its results are of.
            FileProblems: Everything that is wrong with the suite's file.
        """
        folder = out or _meant(name)
        if (manifest := read_manifest(folder)) is not None:
            if out is not None and manifest.suite != paths.title(name):
                raise UserError(f"{out}: holds results of the suite {manifest.suite!r}, not of {paths.title(name)!r}.")
            return cls.of(Store(folder), manifest)
        suite = load_suite(name)
        return cls.read(paths.title(name), Store(folder), suite.episodes(), suite.about)

    @classmethod
    def of(cls, store: Store, manifest: Manifest) -> SuiteFolder:
        """Results now in the folder, of the episodes in the manifest. Raises as `read`."""
        return cls.read(manifest.suite, store, manifest.episodes(), manifest.about)

    @classmethod
    def read(cls, suite: str, store: Store, episodes: Sequence[EpisodeConfig], about: str = "") -> SuiteFolder:
        """What is there now. Raises UserError if it is of another configuration."""
        results = {c: r for c in episodes if (r := store.result(c)) is not None}
        faults = {c: f for c in episodes if c not in results and (f := store.fault(c)) is not None}
        return cls(suite, store, episodes, results, faults, about)


def _meant(name: str) -> Path:
    """The folder of the results of a suite, of its file, or of a folder; a bare name is looked for in `runs` first.

    Raises:
        UserError: There is no such file, or the folder does not say what its results are of.
        UnknownName: Neither a suite nor a folder in `runs` has that name.
    """
    own = Path(name)
    bare = os.sep not in name and not name.startswith(".") and not paths.is_file(own)
    folders = [RUNS / name, own] if bare else [own]
    if (found := next((folder for folder in folders if paths.is_file(folder / MANIFEST)), None)) is not None:
        return found
    if not bare or name not in paths.names(FOLDER):
        for folder in filter(paths.is_folder, folders):
            raise UserError(_untold(folder))
    try:
        return RUNS / paths.title(paths.find_or_file(FOLDER, name, "suite"))
    except UnknownName as error:
        raise UnknownName("suite", name, {*error.known, *(folder.name for folder in _below(RUNS))}) from None
    except UserError as error:
        there = RUNS / own.stem
        if paths.is_file(there / MANIFEST):
            raise UserError(f"{error} Results of a suite of that name are in {there}.") from None
        raise


def _untold(folder: Path) -> str:
    """Why nothing can be told of a folder without a manifest, and what to do."""
    below = [str(inner) for inner in _below(folder)]
    if below:
        more = f" and {len(below) - _MOST} more" if len(below) > _MOST else ""
        return f"{folder}: is not the folder of one suite's results. These are: {', '.join(below[:_MOST])}{more}."
    if any(folder.glob("json/*.json")) or any(folder.glob("*/json/*.json")):
        return (
            f"{folder}: holds results, but no {MANIFEST}, which says of what suite they are. "
            f"Name the suite or its file: mpvi suite report SUITE --out {folder}."
        )
    return f"{folder}: holds no results of a suite."


def _below(folder: Path) -> list[Path]:
    """Subfolders with a manifest of their results."""
    return sorted(manifest.parent for manifest in folder.glob(f"*/{MANIFEST}"))


def together(parts: Sequence[SuiteFolder]) -> list[Runs]:
    """The methods of all parts in order; where two have the same name, all are named after their folders, too.

    Raises:
        UserError: A folder is given twice, or one has hidden instances and another public ones.
    """
    folders = [part.store.out.resolve() for part in parts]
    if twice := [folder for folder, count in Counter(folders).items() if count > 1]:
        raise UserError(f"{twice[0]}: is given twice; name different folders of results")
    splits = {part.store.out: config.split for part in parts for config in part.episodes}
    if len(set(splits.values())) > 1:
        told = "; ".join(f"{folder}: {split}" for folder, split in splits.items())
        raise UserError(f"hidden and public instances are not the same and cannot be compared: {told}")
    of_parts = [runs_of(part.episodes, part.results, part.faults, part.store) for part in parts]
    every = [run for runs in of_parts for run in runs]
    if len({run.method for run in every}) == len(every):
        return every
    names = _apart(folders)
    return [
        replace(run, method=f"{name}: {run.method}" if run.episodes[0].method else name)
        for name, runs in zip(names, of_parts, strict=True)
        for run in runs
    ]


def notes(parts: Sequence[SuiteFolder]) -> list[str]:
    """Notes on results shown side by side: their folders, and how their settings and files differ."""
    if len(parts) < 2:
        return []
    kept = {str(part.store.out): manifest for part in parts if (manifest := read_manifest(part.store.out)) is not None}
    return [f"Results of {', '.join(str(part.store.out) for part in parts)}.", *_differences(kept)]


def _differences(kept: Mapping[str, Manifest]) -> Iterator[str]:
    for key, what in (("version", "mpvi_bt"), ("bddl", "bddl")):
        if len({getattr(manifest, key) for manifest in kept.values()}) > 1:
            yield f"Versions of {what}: {', '.join(f'{getattr(m, key)} ({folder})' for folder, m in kept.items())}."
    files = sorted({name for manifest in kept.values() for name in manifest.files})
    changed = [n for n in files if len({m.files[n] for m in kept.values() if n in m.files}) > 1]
    if changed:
        more = f" and {len(changed) - _MOST} more" if len(changed) > _MOST else ""
        yield f"Not the same in all folders: {', '.join(changed[:_MOST])}{more}."


def _apart(folders: Sequence[Path]) -> list[str]:
    """Names that tell folders apart: the last parts of their paths, as few as will do."""
    for count in range(1, max(len(folder.parts) for folder in folders) + 1):
        names = ["/".join(folder.parts[-count:]) for folder in folders]
        if len(set(names)) == len(names):
            return names
    raise AssertionError("the folders are different ones")
