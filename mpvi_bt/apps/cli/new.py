"""`mpvi new`: files to begin with."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from mpvi_bt.apps.cli.argument_types import File, Finite
from mpvi_bt.executive.drawing.terminal import tell

if TYPE_CHECKING:
    from mpvi_bt.apps.authoring.skeletons import Skeleton


_FILE = click.Path(dir_okay=False, path_type=Path)


@click.group()
def new() -> None:
    """Write files to begin with: a tree, skill, object, robot, house or task, or a part in Python.

    They go below the first folder of MPVI_PATH, or else below the current one; nothing is written over. What is written
    passes `mpvi check` and runs as it is.
    """


def _named(command: Any) -> Any:
    """The argument and options of every kind."""
    command = click.option("--json", "as_json", is_flag=True, help="For programs: one JSON object.")(command)
    command = click.option(
        "--root",
        type=click.Path(file_okay=False, path_type=Path),
        metavar="DIR",
        help="Write below this folder instead.",
    )(command)
    return click.argument("name", metavar="NAME")(command)


@new.command()
@_named
def tree(name: str, root: Path | None, as_json: bool) -> None:
    """A tree with a parameter that drives to something and picks it up."""
    from mpvi_bt.apps.authoring.skeletons import new_tree

    _write(new_tree(name), root, as_json)


@new.command()
@_named
@click.option(
    "--like",
    type=File("skills"),
    metavar="SKILL",
    default="place_in",
    show_default=True,
    help="Skill with the motion for this one.",
)
def skill(name: str, root: Path | None, as_json: bool, like: str) -> None:
    """A skill that is done as another one is, named by a verb of its own."""
    from mpvi_bt.apps.authoring.skeletons import new_skill

    _write(new_skill(name, like), root, as_json)


@new.command(name="object")
@_named
@click.option(
    "--like",
    metavar="NAME",
    default="block",
    show_default=True,
    help="Shape: a family, or an entry of the catalogue.",
)
@click.option("--synset", metavar="SYNSET", help="BEHAVIOR's name for it.  [default: one of that name]")
@click.option(
    "--mesh", type=_FILE, metavar="FILE", help="Shape from a GLB, OBJ, PLY or STL, or from a URDF with its joints."
)
@click.option(
    "--part", "parts", type=_FILE, multiple=True, metavar="FILE", help="A convex part of the mesh.  [default: computed]"
)
@click.option("--scale", type=Finite(min=1e-6), default=1.0, show_default=True, help="Length of the mesh's unit [m].")
@click.option("--up", type=click.Choice(["y", "z"]), help="Axis that points up.  [default: z of PLY, STL, URDF]")
@click.option("--hulls", type=int, default=16, show_default=True, metavar="N", help="Maximum number of convex parts.")
@click.option("--picture/--no-picture", default=True, help="Draw the thing beside its file.  [default: picture]")
def object_(
    name: str,
    root: Path | None,
    as_json: bool,
    like: str,
    synset: str | None,
    mesh: Path | None,
    parts: tuple[Path, ...],
    scale: float,
    up: Literal["y", "z"] | None,
    hulls: int,
    picture: bool,
) -> None:
    """A thing of the catalogue, for houses and tasks: of a family of shapes, or with a mesh of your own."""
    from mpvi_bt.apps.authoring.skeletons import new_mesh, new_object

    given = _given()
    if mesh is None and (own := given & {"parts", "scale", "up", "hulls"}):
        raise click.UsageError(f"--{min(own).replace('parts', 'part')} is of a mesh; give --mesh.")
    if mesh is not None and "like" in given:
        raise click.UsageError("--like and --mesh are two shapes; give one of them.")
    made = new_object(name, like, synset) if mesh is None else new_mesh(name, mesh, parts, scale, up, hulls, synset)
    _write(made, root, as_json, _portrait if picture else None)


@new.command()
@_named
@click.option("--urdf", type=_FILE, required=True, metavar="FILE", help="Its URDF, expanded if it is xacro.")
@click.option(
    "--base", type=click.Choice(["holonomic", "differential"]), help="How it drives.  [default: by its wheels]"
)
def robot(
    name: str, root: Path | None, as_json: bool, urdf: Path, base: Literal["holonomic", "differential"] | None
) -> None:
    """A robot of your own, from its URDF: joints and cameras are found in it, and what is guessed is said."""
    from mpvi_bt.apps.authoring.robot_skeleton import new_robot
    from mpvi_bt.apps.authoring.skeletons import home

    folder = home() if root is None else root
    _write(new_robot(name, urdf, folder, base), folder, as_json, _left)


@new.command()
@_named
@click.option("--seed", type=click.IntRange(min=0), metavar="N", help="Draw a furnished house by this seed.")
@click.option(
    "--like",
    type=File("tasks/kinds"),
    metavar="KIND",
    default="family",
    show_default=True,
    help="Kind of a drawn house: family, flat, office or one of your own, by name or file.",
)
@click.option("--rooms", metavar="ROOM,...", help="Its rooms, such as kitchen,living_room.  [default: all of its kind]")
@click.option("--from", "source", type=_FILE, metavar="FILE", help="Rebuild a house of ProcTHOR's, JSON or JSON lines.")
@click.option(
    "--line", type=click.IntRange(min=1), default=1, show_default=True, metavar="N", help="Which house of JSON lines."
)
def house(
    name: str,
    root: Path | None,
    as_json: bool,
    seed: int | None,
    like: str,
    rooms: str | None,
    source: Path | None,
    line: int,
) -> None:
    """A house: of two rooms, furnished by a seed, or of ProcTHOR's."""
    from mpvi_bt.apps.authoring.skeletons import new_house, new_imported_house

    if source is not None:
        if own := _given() & {"seed", "rooms", "like"}:
            raise click.UsageError(f"--{min(own)} is of a drawn house; --from rebuilds one that is there.")
        _write(new_imported_house(name, source, line), root, as_json)
        return
    if "line" in _given():
        raise click.UsageError("--line is of a file of houses; give --from.")
    if seed is None and (own := _given() & {"rooms", "like"}):
        raise click.UsageError(f"--{min(own)} is of a drawn house; give --seed.")
    named = () if rooms is None else tuple(room.strip() for room in rooms.split(","))
    _write(new_house(name, seed, named, like), root, as_json)


@new.command()
@_named
def task(name: str, root: Path | None, as_json: bool) -> None:
    """A task with its goal."""
    from mpvi_bt.apps.authoring.skeletons import new_task

    _write(new_task(name), root, as_json)


def _part(kind: str, about: str) -> None:
    """The command of a part in Python."""

    def part(name: str, root: Path | None, as_json: bool) -> None:
        from mpvi_bt.apps.authoring.part_skeletons import new_part

        _write(new_part(kind, name), root or Path(), as_json)

    part.__doc__ = about
    new.command(name=kind)(_named(part))


_part("policy", "A policy in Python, in the current folder.")
_part("detector", "A detector in Python, in the current folder.")
_part("navigator", "A navigator in Python, in the current folder.")
_part("checker", "A completion checker in Python, in the current folder.")


@new.command()
@_named
def node(name: str, root: Path | None, as_json: bool) -> None:
    """A node of trees in Python, with a tree beside it that has it."""
    from mpvi_bt.apps.authoring.part_skeletons import new_node

    _write(new_node(name), root, as_json)


def _given() -> set[str]:
    """Names of the parameters that are on the command line."""
    context = click.get_current_context()
    said = click.core.ParameterSource.COMMANDLINE
    return {str(p.name) for p in context.command.params if context.get_parameter_source(str(p.name)) == said}


def _left(files: list[Path]) -> tuple[list[Path], list[str]]:
    """What is still to be filled in of a robot's file, a line each; no more files."""
    from mpvi_bt.apps.authoring.checking import problems_in

    problems = [problem for problem in problems_in(str(files[0])) if problem.severity != "note"]
    return [], [f"to be filled in: {problem}" for problem in problems]


def _portrait(files: list[Path]) -> tuple[list[Path], list[str]]:
    """Draw the entry of a catalogue's file beside it: the picture's file, or a remark why there is none."""
    from mpvi_bt.apps.cli.show import draw
    from mpvi_bt.ground.errors import NoRenderingDevice
    from mpvi_bt.house.things.catalogue import load_catalogue

    (entry,) = load_catalogue(files[0])
    picture = files[0].with_suffix(".png")
    if picture.exists():
        return [], [f"{picture}: is there already; `mpvi show {entry.name} --out FILE` draws another"]
    try:
        draw(entry, picture)
    except NoRenderingDevice as error:
        return [], [f"not drawn: {error}"]
    return [picture], []


def _write(
    skeleton: Skeleton,
    root: Path | None,
    as_json: bool,
    more: Callable[[list[Path]], tuple[list[Path], list[str]]] | None = None,
) -> None:
    """Write the files and say what to do next. `more`: writes others, of these files, and has remarks."""
    from mpvi_bt.apps.authoring.skeletons import found_by, home

    folder = home() if root is None else root
    export = "" if any(place.endswith(".py") for place in skeleton.files) else found_by(folder)
    here = Path.cwd()
    files = skeleton.write(folder)
    others, remarks = more(files) if more is not None else ([], [])
    written = [p.relative_to(here) if p.is_relative_to(here) else p for p in [*files, *others]]
    remarks = [*skeleton.remarks, *remarks]
    below = "" if folder.resolve() == Path.cwd() else f"{folder}/"
    commands = [*([export] if export else []), *(command.replace("ROOT/", below) for command in skeleton.next)]
    if as_json:
        told = {"written": [str(path) for path in written], "next": commands, "remarks": remarks}
        tell(json.dumps(told, indent=2))
        return
    for line in (*(f"wrote {path}" for path in written), *remarks, "next:", *(f"  {c}" for c in commands)):
        tell(line)
