"""`python -m benchmarks.faults.mutants`: files of every kind that is read, broken in one way or another.

Each is read, or refused in words that name it; how a file has to be is judged here by other means than the project's:
PyYAML's own tree, Python's own JSON, the arrays of the whole file.
"""

from __future__ import annotations

import functools
import io
import json
import math
import resource
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import numpy as np
import yaml

from benchmarks.faults.samples import Kind, kinds
from benchmarks.faults.trials import Outcome, drawn, judged, options, play
from benchmarks.faults.user_samples import user_kinds

MOST_MB = 2000  # of memory more than at first
CPU_S, WALL_S = 5.0, 60.0


class Mutants:
    """Trials of files in a folder of their own.

    Args:
        seed: Of the mutants.
        folder: Where they are written.
        found: The kinds of files; None: all.
    """

    def __init__(self, seed: int, folder: Path, found: list[Kind] | None = None) -> None:
        self._seed, self._folder = seed, folder
        self.kinds = [*kinds(folder / "made"), *user_kinds(folder / "made")] if found is None else found

    def made(self, number: int) -> tuple[Kind, str, str, bytes, bytes]:
        """Kind, place, what was done, the good and the broken file of a number."""
        draw = drawn(self._seed, number)
        kind = draw.choice(self.kinds)
        place = draw.choice(sorted(kind.files))
        good = kind.files[place]
        what, broken = draw.choice(kind.mutations)(good, draw)
        return kind, place, what, good, broken

    def __call__(self, number: int) -> Outcome:
        """Read one mutant."""
        kind, place, what, good, broken = self.made(number)
        path = self._folder / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(broken)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                named = "" if kind.name in ("ledger", "manifest", "saved run") else path.name
                outcome = judged(f"{kind.name}: {what}", lambda: kind.read(path), CPU_S, WALL_S, named)
        finally:
            path.unlink(missing_ok=True)
        if outcome.ended == "went on" and (wrong := due(kind, what, good, broken)):
            return Outcome(outcome.of, "misread", f"{place}: read without a complaint, though {wrong}")
        return outcome


def due(kind: Kind, what: str, good: bytes, broken: bytes) -> str:
    """Why a file has to be refused; "" if that is not sure."""
    if kind.form == "arrays":
        return _arrays_differ(good, broken)
    if not kind.form:
        return ""
    try:
        text = broken.decode("utf-8")
    except UnicodeDecodeError:
        return "it is no UTF-8" if b"\0" not in broken[:4] and kind.form not in ("lines", "json") else ""
    if kind.form == "digest":
        return _digest_differs(good, text)
    if kind.form == "lines":
        return _lines_broken(text)
    if kind.form == "json":
        return _json_broken(text)
    if what in ("a key renamed at the top", "a key too many at the top") and _strict(kind):
        return "a key at its top is nobody's"
    return _yaml_broken(text)


def _strict(kind: Kind) -> bool:
    """Whether keys at the top are known ones; those of prompts are names of tasks."""
    return kind.name != "prompts"


def _json_broken(text: str) -> str:
    def refuse(number: str) -> Any:
        raise ValueError(number)

    try:
        json.loads(text, parse_constant=refuse)
    except ValueError as error:
        return f"it is no JSON ({error})"
    except RecursionError:
        return "it is deep"
    return ""


def _arrays_differ(good: bytes, broken: bytes) -> str:
    def read(data: bytes) -> dict[str, Any]:
        with np.load(io.BytesIO(data), allow_pickle=False) as kept:
            return dict(kept)

    try:
        found = read(broken)
    except Exception as error:  # whatever zipfile, zlib and numpy make of it
        return f"it is no archive of arrays ({type(error).__name__})"
    due = read(good)
    bad = [n for n, a in due.items() if not isinstance(found.get(n), np.ndarray) or not _same(a, found[n])]
    return f"its array {bad[0]!r} is another" if bad else ""


def _same(a: Any, b: Any) -> bool:
    """Whether arrays are equal. Lists of words only need to be as long: other words are another file's."""
    if a.ndim and a.dtype.kind == b.dtype.kind == "U":
        return bool(a.shape == b.shape)
    return a.shape == b.shape and bool(np.array_equal(a, b, equal_nan=a.dtype.kind == "f" and b.dtype.kind == "f"))


def _digest_differs(good: bytes, text: str) -> str:
    due = json.loads(good)
    try:
        found = json.loads(text)
    except ValueError:
        return "it is no JSON"
    except RecursionError:
        return "it is deep"
    if not isinstance(found, dict):
        return "it is no mapping"
    if found.get("digest") is None:  # of a version that wrote none
        return ""
    changed = [
        key for key in due.keys() | found.keys() if key != "wall" and _plain(due.get(key)) != _plain(found.get(key))
    ]
    return f"{changed[0]!r} is not what was written" if changed else ""


def _plain(value: Any) -> str:
    return json.dumps(value, sort_keys=True)


def _lines_broken(text: str) -> str:
    lines = text.split("\n")
    for number, line in enumerate(lines[:-2], start=1):
        try:
            json.loads(line)
        except ValueError:
            return f"line {number} is no JSON" if line.strip() else ""
        except RecursionError:
            return f"line {number} is deep"
    return ""


def _yaml_broken(text: str) -> str:
    if len(text) > 200_000:
        return ""
    try:
        root = yaml.compose(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except yaml.YAMLError as error:
        return f"it is no YAML ({type(error).__name__})"
    except (RecursionError, ValueError):
        return ""
    for node in _nodes(root, set()):
        if isinstance(node, yaml.MappingNode):
            keys = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
            if twice := next((key for key in keys if keys.count(key) > 1), None):
                return f"key {twice!r} stands twice"
        elif (
            isinstance(node, yaml.ScalarNode) and node.tag.endswith(":float") and not math.isfinite(_float(node.value))
        ):
            return f"{node.value} is no number to go by"
    return ""


def _nodes(node: Any, seen: set[int]) -> Iterator[Any]:
    left = [node]
    while left:
        node = left.pop()
        if node is None or id(node) in seen:
            continue
        seen.add(id(node))
        yield node
        if isinstance(node, yaml.MappingNode):
            left += [part for pair in node.value for part in pair]
        elif isinstance(node, yaml.SequenceNode):
            left += node.value


def _float(text: str) -> float:
    special = {".nan": math.nan, ".inf": math.inf, "-.inf": -math.inf, "+.inf": math.inf}
    try:
        return special.get(text.lower()) or float(text.replace("_", ""))
    except ValueError:
        return 0.0  # sixties, as of YAML 1.1


def bounded_memory() -> None:
    """Let this process take no more than so much memory more: a file that asks for it gets a MemoryError."""
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + (MOST_MB << 20),) * 2)


@click.command()
@options(10_000, "mutants")
@click.option("--show", is_flag=True, help="With --only: write the mutant itself, and read nothing.")
def main(seed: int, count: int, out: Path, only: int | None, show: bool) -> None:
    """Read broken files of every kind, and say what came of it."""
    with tempfile.TemporaryDirectory(prefix="mutants") as folder:
        mutants = Mutants(seed, Path(folder).resolve())
        if show and only is not None:
            kind, place, what, _, broken = mutants.made(only)
            click.echo(f"{kind.name} {place}: {what}", err=True)
            click.get_binary_stream("stdout").write(broken)
            return
        bounded_memory()
        play(functools.partial(Mutants.__call__, mutants), seed, count, out, only, "mutants")


if __name__ == "__main__":
    main()
