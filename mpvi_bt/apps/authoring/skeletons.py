"""Files to begin with, as `mpvi new` writes them: each passes `mpvi check` and runs as it is."""

from __future__ import annotations

import keyword
import os
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml
from numpy.typing import NDArray

from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import UnknownName, UserError, shown, with_article
from mpvi_bt.ground.writing import unwritable, write_whole
from mpvi_bt.house.generated.generator import generated_house
from mpvi_bt.house.generated.seeded_name import FAMILY
from mpvi_bt.house.goals.problem import activities
from mpvi_bt.house.goals.vocabulary import behavior
from mpvi_bt.house.things.catalogue import FOLDER as CATALOGUES
from mpvi_bt.house.things.catalogue import load_catalogue
from mpvi_bt.house.things.families import FAMILIES, family

_ANY_SYNSET = "toy_figure.n.01"  # of a mesh that is called by no name of BEHAVIOR's
_DENSITY = 300.0  # kg/m^3. Our choice: of household things, hollow as they are
_NAME = re.compile(r"[a-z][a-z0-9_]{0,59}")
_FIRST = re.compile(r"\([^()]*\)|\S+")  # a phrase's verb, or verbs


@dataclass(frozen=True)
class Skeleton:
    """Files to begin with.

    Attributes:
        files: Text of each, by its place below a root; of code: below the current folder.
        next: Commands to go on with; "ROOT/" stands for the folder that the files are written below.
        remarks: What to know before, a line each.
    """

    files: Mapping[str, str]
    next: tuple[str, ...]
    remarks: tuple[str, ...] = ()

    def write(self, root: Path) -> list[Path]:
        """Write them all, or none.

        Raises:
            UserError: One of them is there already, or cannot be written.
        """
        targets = {root / place: text for place, text in self.files.items()}
        for path in targets:
            if path.exists():
                raise UserError(f"{path}: is there already; choose another name, or remove it.")
        for path, text in targets.items():
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise unwritable(path, error) from None
            write_whole(path, text)
        return list(targets)


def checked_name(kind: str, name: str, known: Mapping[str, Any] | list[str]) -> str:
    """The name, if a new thing of that kind can have it.

    Args:
        kind: Such as "skill".
        name: As given.
        known: The names that are taken; of a mapping the values say by what.

    Raises:
        UserError: It can be none, or it is taken; the message has one that would do.
    """
    if not _NAME.fullmatch(name) or keyword.iskeyword(name):
        raise UserError(
            f"{shown(name)} cannot name {with_article(kind)}: lower case letters, digits and underscores, a letter "
            f"first, 60 at most. {free_name(kind, name, known)!r} would do."
        )
    if name in known:
        whose = f" ({known[name]})" if isinstance(known, Mapping) else ""
        raise UserError(
            f"there is {with_article(kind)} {name!r} already{whose}, and two of one name would hide each other. "
            f"{free_name(kind, name, known)!r} is free."
        )
    return name


def free_name(kind: str, name: str, known: Mapping[str, Any] | list[str]) -> str:
    """The nearest name to one that can be none, or is taken."""
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name)
    near = re.sub(r"[^a-z0-9]+", "_", words.lower()).strip("_")[:50]
    near = near if _NAME.fullmatch(near) and not keyword.iskeyword(near) else f"my_{near or kind}"
    mine = [] if near.startswith("my_") else [f"my_{near}"]
    return next(free for free in (near, *mine, *(f"{near}_{n}" for n in range(2, 10_000))) if free not in known)


def _files(folder: str) -> dict[str, Path]:
    return {path.stem: path for path in reversed(paths.files(folder))}


def new_tree(name: str) -> Skeleton:
    """A tree that drives to a place and picks something up, with a retry."""
    checked_name("tree", name, _files("trees"))
    return Skeleton(
        {f"trees/{name}.yaml": _TREE.format(name=name)},
        (f"mpvi render {name}", f"mpvi run --dry --tree {name} --no-watch", f"mpvi run picking_up_trash --tree {name}"),
    )


def new_skill(name: str, like: str = "place_in") -> Skeleton:
    """A skill that is done as another one is, named by a verb of its own.

    Raises:
        UserError: The name is none or taken, or there is no skill to be like.
    """
    skills = load_skills()
    checked_name("skill", name, _files("skills"))
    if like not in skills:
        raise UnknownName("skill", like, skills)
    model = skills[like]
    phrase = _FIRST.sub(name.replace("_", " "), model.phrases[0], count=1)
    content: dict[str, Any] = {
        "name": name,
        "about": f"As {like}: {model.about}",
        "like": model.like or like,
        "phrases": [phrase],
        "hands": model.hands,
        **({"shows": model.shows} if model.shows else {}),
        "triggers": [trigger.model_dump(exclude_none=True) for trigger in model.triggers],
        "timeout_s": model.timeout_s,
    }
    return Skeleton(
        {f"skills/{name}.yaml": _SKILL + yaml.safe_dump(content, sort_keys=False, width=1000, allow_unicode=True)},
        ("mpvi list skills", f"mpvi check ROOT/skills/{name}.yaml"),
        (f"policies of ours do it as {content['like']!r}; take `like` out if yours has a motion of its own for it",),
    )


def new_object(name: str, like: str = "block", synset: str | None = None) -> Skeleton:
    """An entry of the catalogue with the shape of a family, copied from the family's first entry.

    Args:
        name: Of the entry.
        like: A family of shapes, or the name of an entry to begin from.
        synset: BEHAVIOR's name for it; None: one of that very name, or else that of the entry that it begins from.

    Raises:
        UserError: The name is none or taken, there is no such family or entry, or no such synset.
    """
    catalogue = load_catalogue()
    checked_name("catalogue entry", name, {entry.name: entry.family for entry in catalogue})
    model = next((entry for entry in catalogue if entry.family == like), None) or catalogue.entries.get(like)
    if model is None and like in FAMILIES:
        raise UserError(f"{with_article(like)} has its shape from a file: give --mesh FILE.")
    if model is None:
        raise UnknownName("family or catalogue entry", like, [*FAMILIES, *catalogue.entries])
    chosen, remark = _synset(name, synset, model.synset)
    entry: dict[str, Any] = {
        "synset": chosen,
        "phrases": [name.replace("_", " ")],
        "family": model.family,
        "shape": {key: _plain(value) for key, value in model.shape.items()},
        **model.model_dump(mode="json", include={"mass_kg", "rolling_damping", "abilities"}, exclude_defaults=True),
    }
    about = (family(model.family).__doc__ or "").splitlines()[0]
    remarks = (_measured(model.description.extent(visible=True)), *([remark] if remark else []))
    return Skeleton(
        {f"{CATALOGUES}/{name}.yaml": _OBJECT.format(about=about) + _dumped({"entries": {name: entry}})},
        (
            f"mpvi check ROOT/{CATALOGUES}/{name}.yaml",
            f"mpvi show {name}",
        ),
        remarks,
    )


def new_mesh(
    name: str,
    file: Path,
    parts: Sequence[Path] = (),
    scale: float = 1.0,
    up: Literal["y", "z"] | None = None,
    hulls: int = 16,
    synset: str | None = None,
) -> Skeleton:
    """An entry of the catalogue with the shape of a mesh, and that mesh as a file of ours.

    Args:
        name: Of the entry.
        file, parts, scale, up, hulls: As of `mesh_import.import_mesh`.
        synset: BEHAVIOR's name for it; None: one of that very name.

    Raises:
        UserError: The name is none or taken, there is no such synset; or as `mesh_import.import_mesh`.
    """
    from mpvi_bt.house.things.mesh_file import bounds_of, mesh_text
    from mpvi_bt.house.things.mesh_import import import_mesh, volume_of

    checked_name("catalogue entry", name, {entry.name: entry.family for entry in load_catalogue()})
    chosen, remark = _synset(name, synset, _ANY_SYNSET)
    made = import_mesh(file, parts, scale, up, hulls)
    shape: dict[str, Any] = {"file": f"meshes/{name}.obj"}
    if made.joints:
        shape["joints"] = made.joints
    entry = {
        "synset": chosen,
        "phrases": [name.replace("_", " ")],
        "family": "mesh",
        "shape": shape,
        "mass_kg": round(float(np.clip(_DENSITY * volume_of(made.bodies), 0.02, 50.0)), 3),
    }
    count = sum(len(body.hulls) for body in made.bodies.values())
    size = _measured(bounds_of(made.bodies.values()))
    files = {
        f"{CATALOGUES}/{name}.yaml": _MESH + _dumped({"entries": {name: entry}}),
        f"{CATALOGUES}/meshes/{name}.obj": mesh_text(made.bodies),
    }
    remarks = [f"{size}; {count} convex part{'s' * (count != 1)}", *made.remarks, *([remark] if remark else [])]
    return Skeleton(files, (f"mpvi check ROOT/{CATALOGUES}/{name}.yaml", f"mpvi show {name}"), tuple(remarks))


def _measured(extent: NDArray[np.float64]) -> str:
    """The sides of a box (2, 3), low and high corner [m], in words."""
    depth, width, height = extent[1] - extent[0]
    return f"{height:.3f} m high (z), {depth:.3f} m deep (x, front to back), {width:.3f} m wide (y)"


def _synset(name: str, given: str | None, otherwise: str) -> tuple[str, str]:
    """BEHAVIOR's name for a thing, and a remark on the choice. Raises UnknownName."""
    known = behavior().synsets or frozenset()
    if given is not None and given not in known:
        raise UnknownName("synset", given, known)
    own = sorted(word for word in known if word.rsplit(".", 2)[0] == name)
    chosen = given or (own[0] if own else otherwise)
    said = "" if given or own else f"BEHAVIOR has no {name!r}; it is filed as {chosen}: --synset says otherwise"
    return chosen, said


def new_house(name: str, seed: int | None = None, rooms: Sequence[str] = (), like: str = FAMILY) -> Skeleton:
    """A house of two rooms; with a seed, one that is drawn.

    Args:
        name: Of the house.
        seed: Of all that is drawn.
        rooms: Which rooms a drawn house has; all that the kind has if none are named.
        like: Name or file of the kind of a drawn house.

    Raises:
        UnknownName: There are no such rooms, or there is no such kind.
        UserError: The name is taken, or no house has just these rooms.
    """
    checked_name("house", name, _files("tasks/houses"))
    place = f"tasks/houses/{name}.yaml"
    text = _HOUSE if seed is None else generated_house(seed, rooms, like)
    return Skeleton({place: text}, (f"mpvi check ROOT/{place}",), (f"a task is there by `house: {name}`",))


def new_imported_house(name: str, file: Path, line: int = 1) -> Skeleton:
    """A house of ProcTHOR's, rebuilt from fixtures of the catalogue; what is other than there is in its remarks.

    Args:
        name: Of the house.
        file, line: As `imported_house` takes them.

    Raises:
        UserError: The name is taken, or as of `imported_house`.
    """
    from mpvi_bt.house.imported.imported_house import imported_house

    checked_name("house", name, _files("tasks/houses"))
    place = f"tasks/houses/{name}.yaml"
    text, said = imported_house(file, line)
    return Skeleton({place: text}, (f"mpvi check ROOT/{place}", f"mpvi show {name}"), tuple(said))


def new_task(name: str) -> Skeleton:
    """A task with its goal: a can from a table into a bin."""
    taken: dict[str, Any] = {**activities(), **_files("tasks/plans"), **_files("tasks")}
    checked_name("task", name, taken)
    files = {
        f"tasks/{name}.yaml": _TASK,
        f"tasks/problems/{name}.bddl": _PROBLEM,
    }
    return Skeleton(
        {place: text.format(name=name) for place, text in files.items()},
        (
            "mpvi check ROOT/tasks",
            f"mpvi compile {name}",
            f"mpvi run {name} --no-watch",
        ),
    )


def home() -> Path:
    """The root that new files go to: the first folder of `MPVI_PATH`, or else the current folder."""
    return paths.roots()[0] if len(paths.roots()) > 1 else Path()


def found_by(root: Path) -> str:
    """The command that makes a root known, or "" if it is known."""
    if root.resolve() in [known.resolve() for known in paths.roots()]:
        return ""
    others = os.environ.get("MPVI_PATH", "")
    return f"export MPVI_PATH={shlex.quote(str(root.resolve()))}" + (f":{shlex.quote(others)}" if others else "")


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _dumped(content: Any) -> str:
    """As YAML, short lists on one line."""
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=1000, allow_unicode=True)


_TREE = """\
# What nodes there are: mpvi list nodes. The format: docs/trees.md.
tree: {name}
about: Drive to something and pick it up; try again where that fails.
parameters:
  object: {{type: text, default: can of soda}}
root:
  retry: 3
  child:
    sequence: fetch the $object
    memory: true
    children:
      - timeout: 120
        child:
          navigate: $object
      - timeout: 90
        child:
          until_complete: pick up the $object
          children:
            - manipulate: pick up the $object
            - check_complete: a $object is held in a gripper
              skill: pick
"""

_SKILL = """\
# A skill is what a manipulation segment of a plan may ask for. In a phrase (a|b) is a choice, [c] may be left out, and
# {slot} is any words. It is asked whether the skill is complete when a trigger's event happens; the camera then looks.
"""

_OBJECT = """\
# {about}
# Lengths in meters: size_m is depth (x, front to back), width (y), height (z). What has a mass can be moved.
"""

_MESH = """\
# A mesh. What it can hold are volumes, what a hand takes it by from above are grips: boxes that nobody sees, such as
#   volumes: [{kind: box, at: [0, 0, 0.05], size_m: [0.1, 0.1, 0.08]}]
# Without a mass it is a fixture of houses. The mass is a guess.
"""

_HOUSE = """\
# Two rooms side by side: x runs east, y north, meters. A fixture stands with the middle of its underside `at` [x, y];
# yaw_deg is where its front faces: 0 east, 90 north. What there is to put up: tasks/catalogues/objects.yaml.
outside: "#efe6d6"
doorways:
  - {between: [kitchen, living_room], at: [4.0, 2.0], width_m: 1.4}
rooms:
  kitchen:
    rect: [0.0, 0.0, 4.0, 4.0]
    floor: "#9fb0ab"
    walls: "#f6ecd4"
    fixtures:
      counter_1: {entry: counter, at: [1.2, 0.4], yaw_deg: 90}
  living_room:
    rect: [4.0, 0.0, 9.0, 4.0]
    floor: "#c08e5c"
    walls: "#f5ecdc"
    phrases: [lounge]
    fixtures:
      coffee_table_1: {entry: coffee_table, at: [7.0, 2.0], yaw_deg: 90}
      sofa_1: {entry: sofa, at: [7.0, 0.5], yaw_deg: 90}
"""

_TASK = """\
instruction: Put the can of soda that stands on the coffee table into the trash can.
problem: {name}  # tasks/problems/: what there is, where it begins, and the goal
house: family_house
bindings:  # BEHAVIOR's name of each movable thing to an entry of the catalogue
  can__of__soda.n.01: can_of_soda
  ashcan.n.01: trash_can
instances: 10  # start states, drawn from what the problem's :init says
time_budget_s: 300
"""

_PROBLEM = """\
; One can, from the table into the bin. Names are BEHAVIOR's synsets, each thing numbered from 1.
(define (problem {name}-0)
  (:domain behavior-1k)
  (:objects
    can__of__soda.n.01_1 - can__of__soda.n.01
    ashcan.n.01_1 - ashcan.n.01
    coffee_table.n.01_1 - coffee_table.n.01
    floor.n.01_1 - floor.n.01
    agent.n.01_1 - agent.n.01)
  (:init
    (inroom floor.n.01_1 living_room)
    (inroom coffee_table.n.01_1 living_room)
    (ontop can__of__soda.n.01_1 coffee_table.n.01_1)
    (ontop ashcan.n.01_1 floor.n.01_1)
    (ontop agent.n.01_1 floor.n.01_1))
  (:goal
    (and (inside can__of__soda.n.01_1 ashcan.n.01_1))))
"""
