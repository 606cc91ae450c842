"""BEHAVIOR's vocabulary: predicates, synsets, rooms and abilities, from the `bddl` distribution's data.

The package itself is never imported: its knowledge base takes minutes.
"""

from __future__ import annotations

import csv
import difflib
import json
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from mpvi_bt.ground.errors import UserError, shown
from mpvi_bt.house.goals.expressions import Form, read_expressions
from mpvi_bt.house.goals.findings import Findings

_NAME = re.compile(r'"name": "([^"]+)"')
_CLOSE = 5  # names that a message about a misspelt synset lists


@dataclass(frozen=True)
class BddlVocabulary:
    """Names that a problem may use; None: any name is taken.

    Attributes:
        predicates: With the number of things that each is about.
        synsets: Of things.
        fixtures: Those of them that stand in a room from the start.
        rooms: As `inroom` names them.
    """

    predicates: Mapping[str, int] | None = None
    synsets: frozenset[str] | None = None
    fixtures: frozenset[str] = frozenset()
    rooms: frozenset[str] | None = None


ANY = BddlVocabulary()


@cache
def behavior() -> BddlVocabulary:
    """BEHAVIOR's own names: WordNet's synsets as far as it has them, its own, and those above them.

    Raises:
        UserError: The distribution is not installed, or holds other data.
    """
    with _data("generated_data/synsets.csv").open(encoding="utf-8", newline="") as file:
        rows = [(row["synset"], row["sceneObject"]) for row in csv.DictReader(file)]
    above = _NAME.findall(_data("generated_data/output_hierarchy.json").read_text(encoding="utf-8"))
    rooms = _data("generated_data/allowed_room_types.csv").read_text(encoding="utf-8").split()
    return BddlVocabulary(
        predicates=predicates(),
        synsets=frozenset({*above, *(name for name, _ in rows)}),
        fixtures=frozenset(name for name, fixed in rows if fixed == "1"),
        rooms=frozenset(rooms[2:]),  # the first line is "Room Name"
    )


@cache
def predicates() -> Mapping[str, int]:
    """BEHAVIOR's predicates, and how many things each is about. Raises UserError as `behavior`."""
    path = _data("activity_definitions/domain_omnigibson.bddl")
    domain = read_expressions(path.read_text(encoding="utf-8"), Findings(str(path)))[0]
    section = next(part for part in domain if isinstance(part, Form) and part[0] == ":predicates")
    return {str(form[0]): len(form) - 1 for form in section[1:]}


@cache
def abilities() -> frozenset[str]:
    """What things can be to BEHAVIOR, such as "fillable". Raises UserError as `behavior`."""
    text = _data("generated_data/properties_to_synsets.json").read_text(encoding="utf-8")
    return frozenset(json.loads(text))


def unknown_synset(given: str, known: Collection[str]) -> dict[str, Any]:
    """The problem's fields for an unknown synset, with a few near ones of thousands."""
    words: dict[str, list[str]] = {}
    for synset in sorted(known):
        words.setdefault(_words(synset), []).append(synset)
    near = [
        synset for word in difflib.get_close_matches(_words(given[:100]), words, n=_CLOSE) for synset in words[word]
    ]
    hint = f" Did you mean {near[0]!r}?" if near else " It is none of BEHAVIOR's."
    return {
        "code": "unknown-synset",
        "message": f"unknown synset {shown(given)}.{hint}",
        "nearest": near[0] if near else None,
        "known": tuple(near),
    }


def _words(synset: str) -> str:
    """A synset without its part of speech and number, which all have alike."""
    return synset.rsplit(".", 2)[0]


def _data(name: str) -> Path:
    """A file of the distribution's data."""
    try:
        path = Path(str(metadata.distribution("bddl").locate_file(f"bddl/{name}")))
    except metadata.PackageNotFoundError:
        raise UserError(ABSENT) from None
    if not path.is_file():
        raise UserError(f"the distribution 'bddl' {metadata.version('bddl')} has no {name}: pip install 'bddl<4'")
    return path


ABSENT = "the distribution 'bddl', which holds the goals, is not installed: pip install bddl"
