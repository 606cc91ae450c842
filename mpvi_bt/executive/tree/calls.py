"""Calls of subtrees: the file of the callee, and a check of the arguments against its parameters."""

from __future__ import annotations

from pathlib import Path

from mpvi_bt.executive.behaviors.parameters import Call
from mpvi_bt.executive.tree.tree_file import TreeReading, TreeSource, due, fits, head_of
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems, MpviError, UnknownName, UserError, shown
from mpvi_bt.ground.file_kinds import expect
from mpvi_bt.ground.marked_yaml import Location, SourceMarks, load_marked


def called_file(
    call: Call, at: Location, marks: SourceMarks, reading: TreeReading, above: tuple[Path, ...]
) -> tuple[Path, TreeSource] | None:
    """The file that a subtree node calls, or None if it cannot be called so; then `reading` has the problems.

    Args:
        call: Of the node.
        at: Where the call's name stands.
        marks: Of the calling file.
        reading: Of the whole tree.
        above: The calling file and those that called it, outermost first.
    """
    path = _find(call.tree, at, marks, reading)
    source = _source(path, at, marks, reading, above) if path else None
    if path is None or source is None or not _fit(call, path, source, at, marks, reading):
        return None
    return path, source


def _find(name: str, at: Location, marks: SourceMarks, reading: TreeReading) -> Path | None:
    """The file that a subtree names: one beside this file, or a tree of a root."""
    folder = Path(marks.file).parent
    if "/" in name or name.endswith(paths.SUFFIXES):
        if paths.is_file(path := folder / name):
            return path
        reading.add(marks.problem(at, "unknown-tree", f"there is no file {name!r} in {str(folder)!r}"))
        return None
    beside = {p.stem: p for p in reversed(paths.files_in(folder)) if p.suffix != ".json"}  # these are plans
    if name in beside:
        return beside[name]
    try:
        return paths.find("trees", name)
    except UnknownName:
        known = {*(beside if paths.is_file(Path(marks.file)) else ()), *paths.names("trees")}
        reading.add(marks.unknown(at, "tree", name, known))
    except MpviError as error:
        reading.add(marks.problem(at, "unknown-tree", str(error)))
    return None


def _source(
    path: Path, at: Location, marks: SourceMarks, reading: TreeReading, above: tuple[Path, ...]
) -> TreeSource | None:
    """A subtree's file, or None if it cannot be used here."""
    own = path.resolve()
    if own in above:
        chain = " -> ".join(file.stem for file in (*above[above.index(own) :], own))
        reading.add(marks.problem(at, "recursion", f"a tree can't contain itself: {chain}"))
        return None
    if own not in reading.sources:
        reading.sources[own] = None
        try:
            data, its_marks = load_marked(path)
            expect("tree", data, its_marks)
            reading.sources[own] = TreeSource(data, its_marks, head_of(data, its_marks, reading))
        except FileProblems as error:
            reading.problems += error.problems
        except UserError as error:
            reading.add(marks.problem(at, "unreadable", str(error)))
    return reading.sources[own]


def _fit(call: Call, path: Path, source: TreeSource, at: Location, marks: SourceMarks, reading: TreeReading) -> bool:
    """Whether the arguments are those that the called tree takes."""
    before = len(reading.problems)
    parameters = source.file.parameters
    for name, value in call.arguments.items():
        where = (*at[:-1], "arguments", name)
        if name not in parameters:
            reading.add(marks.unknown(where, "parameter", name, parameters, key=True, whose=f" of {path}"))
        elif not fits(value, kind := parameters[name].type):
            message = f"parameter {name!r} of {path} must be {due(kind)}, not {shown(value)}"
            reading.add(marks.problem(where, "parameter-type", message))
    for name, parameter in parameters.items():
        if parameter.default is None and name not in call.arguments:
            message = f"tree {call.tree!r} ({path}) needs the argument {name!r}, of type {parameter.type!r}"
            reading.add(marks.problem(at, "missing-argument", message, key=True))
    return len(reading.problems) == before
