"""The families of shapes in words: for lists, and for the page that has a picture of each."""

from __future__ import annotations

import inspect
import json
import types
import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mpvi_bt.ground.marked_yaml import Coordinate
from mpvi_bt.house.things.catalogue import Catalogue, CatalogueEntry
from mpvi_bt.house.things.dimensions import Count, Length, Rgb, Size
from mpvi_bt.house.things.families import FAMILIES, Family

_WORDS: Sequence[tuple[Any, str]] = (
    (Size, "[x, y, z] m"), (Length, "m"), (Coordinate, "m"), (Rgb, "color"), (Count, "1 to 12"),
    (bool, "true or false"), (float, "number"), (int, "whole number"), (str, "text"),
)  # fmt: skip
_HEAD = """\
# Families of shapes

A thing of the [catalogue](../tasks/catalogues/objects.yaml) has the shape of a family, made from its parameters; what
stands behind `=` may be left out. Lengths are in meters, colors are written `"#c8202c"`. Of sizes `[x, y, z]` x is the
depth (front to back), y the width and z the height. What things of [your own](own_tasks.md) look like,
`mpvi show NAME --out FILE.png` draws. This page is written by
`mpvi show --page docs/families.md`.

| | family | parameters |
|---|---|---|
"""
_TAIL = """
## A mesh of your own

    pip install -e '.[mesh]'   # in the clone: trimesh and coacd
    mpvi new object my_mug --mesh mug.glb --synset mug.n.04

makes an entry of a GLB, OBJ, PLY or STL: upright, in meters, its middle over the origin, in up to a dozen colors,
with convex parts for physics. Colors come from vertices, materials and textures, those of an MTL file or a URDF too:
each triangle gets one. What is missing or not read is told. Convex parts are computed, or given: `--part FILE`, as
often as there are any. What is convex already, or made of convex pieces, is taken as it is; coacd takes seconds where
pieces are closed, and minutes where it has to close them first. `--scale 0.001` is for millimeters; `--up` says which
axis points up, where that is not y of GLB and OBJ, and z of PLY and STL. Of a URDF links that turn or shift against
the first become bodies with joints, such as a lid.

The mesh is written beside the entry, as `meshes/NAME.obj`; episodes read only that, and need neither library. Physics
takes the convex parts as they are. Robots, goals and maps take each part for the box around it: more and smaller
parts (`--hulls`) are nearer to the truth, and cost time. What the thing can hold (`volumes`) and what it is taken by
from above (`grips`) are pieces that you add to the entry. A mesh that is broken, flat, of no size that a thing has,
or of more than 50,000 triangles is refused, and so is a part that is not convex.
"""


@dataclass(frozen=True)
class FamilyInfo:
    """A family in words.

    Attributes:
        name: Such as "can".
        about: What it makes, a sentence.
        parameters: Each with what it is, and what holds where it is not said.
        example: The first entry of the catalogue that is of it, or None.
    """

    name: str
    about: str
    parameters: Mapping[str, str]
    example: CatalogueEntry | None


def families(catalogue: Catalogue) -> list[FamilyInfo]:
    """All of them, by name."""
    return [
        FamilyInfo(
            name,
            (inspect.getdoc(FAMILIES[name]) or "").partition("\n\n")[0].replace("\n", " "),
            _parameters(FAMILIES[name]),
            next((entry for entry in catalogue if entry.family == name), None),
        )
        for name in sorted(FAMILIES)
    ]


def _parameters(family: Family) -> dict[str, str]:
    hints = typing.get_type_hints(family, include_extras=True)
    return {key: _parameter(hints[key], p.default) for key, p in inspect.signature(family).parameters.items()}


def family_page(catalogue: Catalogue, folder: str) -> str:
    """The page, as Markdown.

    Args:
        catalogue: With an entry of each family, whose picture stands there.
        folder: Of the pictures, from the page: FAMILY.jpg.
    """
    rows = []
    for info in families(catalogue):
        parameters = "<br>".join(f"`{name}`: {about}" for name, about in info.parameters.items())
        example = f"<br>such as `{info.example.name}`" if info.example else ""
        about = info.about.replace("|", "\\|")
        picture = f"![{info.name}]({folder}/{info.name}.jpg)" if info.example else ""
        rows.append(f"| {picture} | **{info.name}**: {about}{example} | {parameters} |")
    return _HEAD + "\n".join(rows) + "\n" + _TAIL


def _parameter(hint: Any, default: Any) -> str:
    """A parameter's type, and its default if it has one."""
    what = _worded(hint)
    return what if default is inspect.Parameter.empty else f"{what} = {_written(default, what)}"


def _worded(hint: Any) -> str:
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    for known, words in _WORDS:
        if hint == known:
            return words
    if origin in (typing.Union, types.UnionType):
        return _worded(next(member for member in inner if member is not types.NoneType))
    if origin is typing.Literal:
        return " or ".join(map(str, inner))
    if origin is typing.Annotated:
        return _worded(inner[0])
    if origin is Mapping:
        return f"of each by name {_worded(inner[1])}"
    if origin is tuple:
        return f"list of {_worded(inner[0])}" if inner[-1] is Ellipsis else f"[{', '.join(map(_worded, inner))}]"
    return f"{{{', '.join(hint.model_fields)}}}"  # a record


def _written(value: Any, what: str) -> str:
    if what == "color" and value is not None:
        return '"#' + "".join(f"{round(255 * channel):02x}" for channel in value) + '"'
    return json.dumps(value) if value is not None else "none"
