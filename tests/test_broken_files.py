"""Every shipped file, broken in hundreds of ways: each gets a diagnostic near the defect, none a traceback."""

from __future__ import annotations

import random
import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml

from mpvi_bt.apps.authoring.checking import problems_in
from mpvi_bt.ground import paths
from mpvi_bt.ground.marked_yaml import Location, load_marked

ROOT = paths.shipped()
GOOD = sorted(
    path
    for folder in ("trees", "skills", "tasks", "policies", "robots", "bridges")
    for path in (ROOT / folder).rglob("*")
    if path.suffix in (".yaml", ".json") and path.parent.name != "schema"
)
NEAR = 2  # lines
EACH = 2  # sites that an operator breaks in one file
# Whatever stands in these is a name.
NAMED_BY_USER = {"parameters", "blackboard", "rooms", "fixtures", "entries", "images", "state", "cameras", "grippers"}

REQUIRED = {  # by folder
    "trees": {"tree", "memory", "policy"},
    "skills": {"name", "about", "camera", "timeout_s"},
    "plans": {"type", "description", "completion_criterion", "target"},
    "houses": {"outside", "rect", "floor", "walls"},
    "catalogues": {"synset", "family", "shape"},
    "suites": {"tasks", "instances"},
    "kinds": {"day", "rooms", "corridor_m", "area_m2", "shorter_m"},
    "methods": {"about", "planner", "policy", "checker", "trigger"},
    "policies": {"camera", "part", "at"},
    "robots": {"urdf", "joints"},
    "bridges": {"joint_states", "odometry", "base", "color", "depth", "info"},
    "tasks": {"instruction", "problem", "house", "can__of__soda.n.01"},
}
WRONG = {  # key: values that it can't have
    **dict.fromkeys(("timeout", "cooldown", "wait", "timeout_s"), ("0", "-3", "1e99", "'60'", ".nan", "soon")),
    **dict.fromkeys(("retry", "repeat"), ("0", "-1", "2.5", "99999999", "many")),
    **dict.fromkeys(("at_least", "at_most", "add"), ("much", "[1]", ".inf")),
    **dict.fromkeys(("answer_s", "connect_s"), ("0", "-1", "1e9", "later")),
    "look_around": ("900", "round"),
    "part": ("troso", "arm"),
    "at": ("-1", "'3'", "99999"),
    "memory": ("yes", "1", "never"),
    "width_m": ("0.1", "-1", "99"),
    "yaw_deg": ("720", "north"),
    "mass_kg": ("0", "-1", "1e9"),
    "friction": ("-0.1", "17"),
    "wall_height_m": ("-2", "high"),
    "z_m": ("-1", "40"),
    "outside": ("white", "'#12'", "7"),
    "floor": ("red", "'#1234567'"),
    "type": ("nothing", "navigate"),
    "event": ("sneeze",),
    "camera": ("back",),
    "posture": ("yoga",),
    "policy": ("success_on_al", "any"),
    "skill": ("pik", "palce_in"),
    "entry": ("sofaa", "unicorn"),
    "family": ("boxx", "horse"),
    "synset": ("can_of_soda", "can n 01"),
    "problem": ("picking_up_trsh",),
    "house": ("familly_house",),
    "tree": ("''", "[a]"),
    "plan": ("picking_up", "{}"),
    "subtree": ("no_such_tree", "../trees/none.yaml", "''"),
    "set": ("Not A Key", "'1st'"),
    "test": ("Not A Key",),
    "fail": ("Not A Reason",),
    "name": ("other_name", "Other Name"),
    "planner": ("recorde", "openai"),
    "trigger": ("periodic", "periodical:300"),
    "drive": ("navigate", "planner"),
}


@dataclass(frozen=True)
class Site:
    """A key with its value, or an item of a list.

    Attributes:
        at: Location.
        line: 1-based, of the key or the item.
        key: Where the key's text is; None for an item.
        value: Where the value's text is, if it stands on one line; None: it does not.
        data: The value.
        folder: Of the file.
        within: Line at which the mapping or list begins that holds it.
        alone: Whether that holds nothing else.
    """

    at: Location
    line: int
    key: tuple[int, int] | None
    value: tuple[int, int] | None
    data: Any
    folder: str
    within: int
    alone: bool


@dataclass(frozen=True)
class Mutant:
    """A broken file.

    Attributes:
        file: The good one.
        text: Of the broken one.
        line: Where the defect is.
        name: For the report of the tests.
    """

    file: Path
    text: str
    line: int
    name: str


Broken = Iterator[tuple[str, int]]
Operator = Callable[[str, Site, random.Random], Broken]


@cache
def sites_of(path: Path) -> list[Site]:
    """Every place of a file that an operator may break."""
    text = path.read_text()
    data, marks = load_marked(path)
    starts = [0, *(match.end() for match in re.finditer("\n", text))]
    ends = {t.start_mark.index: t.end_mark.index for t in yaml.scan(text) if isinstance(t, yaml.ScalarToken)}
    opened: list[int] = []
    for token in yaml.scan(text):
        if isinstance(token, yaml.FlowMappingStartToken | yaml.FlowSequenceStartToken):
            opened.append(token.start_mark.index)
        elif isinstance(token, yaml.FlowMappingEndToken | yaml.FlowSequenceEndToken):
            ends[opened.pop()] = token.end_mark.index

    def span(place: tuple[int, int]) -> tuple[int, int] | None:
        start = starts[place[0] - 1] + place[1] - 1
        end = ends.get(start)
        return None if end is None or "\n" in text[start:end] else (start, end)

    sites = []
    for at, place in marks.values.items():
        value = around = data
        for part in at:
            value, around = value[part], value
        if at:
            key = marks.keys.get(at)
            line, within, alone = (key or place)[0], marks.values[at[:-1]][0], len(around) == 1
            spans = (span(key) if key else None, span(place))
            sites.append(Site(at, line, *spans, value, path.parent.name, within, alone))
    return sites


def _put(text: str, span: tuple[int, int], new: str) -> str:
    return text[: span[0]] + new + text[span[1] :]


def _own_line(text: str, span: tuple[int, int]) -> tuple[int, int]:
    """The whole line around a span, its end too."""
    return text.rfind("\n", 0, span[0]) + 1, (text.find("\n", span[1]) + 1) or len(text)


def _is_block(text: str, span: tuple[int, int]) -> bool:
    """Whether the line begins there: with a key of a block mapping which is not the first of a list item."""
    return not text[text.rfind("\n", 0, span[0]) + 1 : span[0]].strip()


def _in_braces(text: str, span: tuple[int, int]) -> bool:
    """Whether it stands in a flow mapping, where blanks mean nothing."""
    return text.count("{", 0, span[0]) > text.count("}", 0, span[0])


def misspelt_key(text: str, site: Site, rng: random.Random) -> Broken:
    """A letter too few, or two that changed places."""
    if site.key and not (len(site.at) > 1 and site.at[-2] in NAMED_BY_USER):
        old = text[slice(*site.key)].strip('"')
        i = rng.randrange(len(old) - 1)
        swapped = old[:i] + old[i + 1] + old[i] + old[i + 2 :]
        new = swapped if old[i] != old[i + 1] and rng.random() < 0.5 else old[:i] + old[i + 1 :]
        yield _put(text, site.key, f'"{new}"' if text[site.key[0]] == '"' else new), site.line


def duplicated_key(text: str, site: Site, rng: random.Random) -> Broken:
    """A line twice."""
    if site.key and site.value and _is_block(text, site.key):
        start, end = _own_line(text, site.key)
        comma = "," if text.startswith("{") and text[end - 2] != "," else ""
        yield text[: end - 1] + comma + "\n" + text[start:end] + text[end:], site.line


def removed_key(text: str, site: Site, rng: random.Random) -> Broken:
    """A line gone that has to be there: the defect is the mapping that lacks it."""
    if site.key and site.value and site.at[-1] in REQUIRED[site.folder] and _is_block(text, site.key):
        start, end = _own_line(text, site.key)
        if site.value[0] < end and (not text.startswith("{") or text[end - 2] == ","):
            yield text[:start] + text[end:], site.within


def no_colon(text: str, site: Site, rng: random.Random) -> Broken:
    """A key without its colon."""
    if site.key and text[site.key[1]] == ":" and text[site.key[0]] != '"':
        yield text[: site.key[1]] + text[site.key[1] + 1 :], site.line


def no_value(text: str, site: Site, rng: random.Random) -> Broken:
    """A list where a value should be."""
    if site.value and not isinstance(site.data, dict | list):
        yield _put(text, site.value, "[[1]]"), site.line


def wrong_value(text: str, site: Site, rng: random.Random) -> Broken:
    """A value of the wrong type, or out of range, or a name that is nobody's."""
    wrong = WRONG.get(str(site.at[-1]), ())
    if site.key and site.value and wrong:
        value = rng.choice(wrong)
        yield _put(text, site.value, f'"{value}"' if text[site.value[0]] == '"' else value), site.line


def open_quote(text: str, site: Site, rng: random.Random) -> Broken:
    """A quote that is not closed, or not opened."""
    if site.value and text[site.value[0]] == '"':
        yield text[: site.value[1] - 1] + text[site.value[1] :], site.line
        yield text[: site.value[0]] + text[site.value[0] + 1 :], site.line
    elif site.value and isinstance(site.data, str):
        yield _put(text, site.value, '"' + text[slice(*site.value)]), site.line


def open_bracket(text: str, site: Site, rng: random.Random) -> Broken:
    """A bracket that is not closed, or not opened."""
    if site.value and text[site.value[0]] in "[{":
        yield text[: site.value[1] - 1] + text[site.value[1] :], site.line
        yield text[: site.value[0]] + text[site.value[0] + 1 :], site.line
    elif site.value:
        yield text[: site.value[0]] + "[" + text[site.value[0] :], site.line


def bad_indent(text: str, site: Site, rng: random.Random) -> Broken:
    """A line that is a blank too far in, or out."""
    folded = site.value is None and isinstance(site.data, str)  # that nothing lines up with it shows where it ends
    if site.key and not (site.alone or folded) and _is_block(text, site.key) and not _in_braces(text, site.key):
        start = _own_line(text, site.key)[0]
        yield text[:start] + " " + text[start:], site.line
        if start < site.key[0]:
            yield text[:start] + text[start + 1 :], site.line


def tab(text: str, site: Site, rng: random.Random) -> Broken:
    """A tab for indentation."""
    if site.key and _is_block(text, site.key) and text[site.key[0] - 1] == " " and not text.startswith("{"):
        start = _own_line(text, site.key)[0]
        yield text[:start] + "\t" + text[start:].lstrip(" "), site.line


def foreign(text: str, site: Site, rng: random.Random) -> Broken:
    """What no file of ours may hold: control characters, tags, aliases to nothing."""
    if site.value and not isinstance(site.data, dict | list):
        start = site.value[0]
        yield text[:start] + rng.choice(["\x00", "\x07", "\x1b[2J"]) + text[start:], site.line
        if not text.startswith("{"):
            tag = rng.choice(["!!python/name:os.system ", "!secret ", "*nobody "])
            yield text[:start] + tag + text[start:], site.line


def second_kind(text: str, site: Site, rng: random.Random) -> Broken:
    """A node that is two things, or has the wrong thing below it."""
    if "root" in site.at and site.key and site.value and _is_block(text, site.key) and site.at[-1] == "memory":
        start, end = _own_line(text, site.key)
        indent = text[start : site.key[0]]
        yield text[:end] + indent + rng.choice(["navigate: cup", "retry: 3"]) + "\n" + text[end:], site.line + 1
        yield text[:end] + indent + "child: {succeed: x}\n" + text[end:], site.line + 1


def no_children(text: str, site: Site, rng: random.Random) -> Broken:
    """A composite without children, a decorator with two, a leaf with one."""
    if "root" not in site.at or not site.key or not _is_block(text, site.key):
        return
    start, end = _own_line(text, site.key)
    if site.at[-1] == "children":
        yield text[: site.key[0]] + "child" + text[site.key[1] :], site.line
        yield text[: site.key[1]] + ": []\n", site.line  # and nothing more
        yield text[: site.key[1]] + ": 7\n", site.line
    elif site.at[-1] == "child":
        yield text[: site.key[0]] + "children" + text[site.key[1] :], site.line
    elif site.at[-1] in ("room", "arguments", "add", "skill"):
        indent = text[start : site.key[0]]
        yield text[:end] + indent + "child: {succeed: x}\n" + text[end:], site.line + 1


def wrong_reference(text: str, site: Site, rng: random.Random) -> Broken:
    """A reference to what is not there."""
    if site.value and isinstance(site.data, str) and (found := re.search(r"\$([a-z_]+)", text[slice(*site.value)])):
        at = site.value[0] + found.start(1)
        yield text[:at] + "x" + text[at:], site.line


def wrong_argument(text: str, site: Site, rng: random.Random) -> Broken:
    """An argument that the subtree does not have, of another type, or none; a tree that calls itself."""
    if site.at[-1] == "arguments" and site.value:
        yield _put(text, site.value, "{colour: red}"), site.line
        yield _put(text, site.value, "[object]"), site.line
        first = next(iter(site.data))
        yield _put(text, site.value, f"{{{first}: [1]}}"), site.line
    elif site.at[-1] == "subtree" and site.value:
        yield _put(text, site.value, "THIS_TREE"), site.line


def wrong_phrase(text: str, site: Site, rng: random.Random) -> Broken:
    """A skill's phrase with brackets, braces or slots that are not right."""
    if "phrases" in site.at and isinstance(site.data, str) and "{object}" in site.data and site.value:
        old = text[slice(*site.value)]
        for new in ("{objekt}", "{object", "object}", "{object} {object}", "({object}"):
            yield _put(text, site.value, old.replace("{object}", new, 1)), site.line


def wrong_binding(text: str, site: Site, rng: random.Random) -> Broken:
    """A task that binds what it does not need, or to what is not there."""
    if len(site.at) == 2 and site.at[0] == "bindings" and site.key and site.value:
        yield _put(text, site.key, "sofa.n.01"), site.line
        yield _put(text, site.value, "can_of_sodaa"), site.line
        yield _put(text, site.value, "sofa"), site.line


def wrong_numbers(text: str, site: Site, rng: random.Random) -> Broken:
    """A list of numbers with one too many, one too few, or one that is none."""
    if site.value and isinstance(site.data, list) and site.at[-1] in ("rect", "at", "size_m") and len(site.data) > 1:
        old = text[slice(*site.value)]
        yield _put(text, site.value, old[:-1] + ", 1]"), site.line
        yield _put(text, site.value, f"[{site.data[0]}]"), site.line
        yield _put(text, site.value, old.replace(str(site.data[0]), "far", 1)), site.line
        yield _put(text, site.value, old.replace(str(site.data[0]), ".nan", 1)), site.line


def wrong_suite(text: str, site: Site, rng: random.Random) -> Broken:
    """A suite of unknown tasks, instances that are not there, or the same seed twice."""
    if site.value and site.at in (("tasks",), ("instances",), ("seeds",)) and isinstance(site.data, list):
        new = {"tasks": ["[nothing]", "[]"], "instances": ["[99]", "[-1]"], "seeds": ["[1, 1]", "[x]"]}[str(site.at[0])]
        for value in new:
            yield _put(text, site.value, value), site.line


def wrong_place(text: str, site: Site, rng: random.Random) -> Broken:
    """A doorway between the wrong rooms, or in no wall."""
    if len(site.at) == 3 and site.at[0] == "doorways" and site.value:
        new = {"between": "[kitchen, nowhere]", "at": "[100, 100]"}.get(str(site.at[2]))
        if new:
            yield _put(text, site.value, new), site.line


def comma(text: str, site: Site, rng: random.Random) -> Broken:
    """JSON with a comma too many or too few."""
    if text.startswith("{") and site.value and text[site.value[1] : site.value[1] + 1] == ",":
        yield text[: site.value[1]] + text[site.value[1] + 1 :], site.line
        yield text[: site.value[1]] + ",," + text[site.value[1] + 1 :], site.line


OPERATORS: list[Operator] = [
    misspelt_key, duplicated_key, removed_key, no_colon, no_value, wrong_value, open_quote, open_bracket, bad_indent,
    tab, foreign, second_kind, no_children, wrong_reference, wrong_argument, wrong_phrase, wrong_binding, wrong_numbers,
    wrong_suite, wrong_place, comma,
]  # fmt: skip


def mutants(operator: Operator) -> Iterator[Mutant]:
    """What an operator makes of the good files: the same in every run."""
    for path in GOOD:
        text, sites = path.read_text(), sites_of(path)
        rng = random.Random(f"{path.name} {operator.__name__}")
        shuffled = rng.sample(sites, len(sites))
        made = [one for site in shuffled for one in operator(text, site, rng)]
        for i, (broken, line) in enumerate(rng.sample(made, min(EACH, len(made)))):
            name = f"{path.relative_to(ROOT)}-{operator.__name__}-{i}"
            yield Mutant(path, broken.replace("THIS_TREE", path.stem), line, name)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Trees to call, and a place of the right name for every kind of file."""
    root = tmp_path_factory.mktemp("broken")
    shutil.copytree(ROOT / "trees", root / "trees")
    for path in GOOD:
        (root / path.relative_to(ROOT)).parent.mkdir(parents=True, exist_ok=True)
    for urdf in (ROOT / "robots").glob("*.urdf"):
        shutil.copy(urdf, root / "robots")
    return root


def test_there_are_hundreds_of_every_kind() -> None:
    """At least four hundred files, some of every kind and by every operator, no two alike."""
    made = {operator: list(mutants(operator)) for operator in OPERATORS}
    assert all(made.values())
    assert len({mutant.text for some in made.values() for mutant in some}) >= 400
    assert {mutant.file for some in made.values() for mutant in some} == set(GOOD)


def test_what_is_broken_below_is_good_before() -> None:
    """The files that the mutants are made of have no problems."""
    assert [problem for path in GOOD for problem in problems_in(str(path))] == []


@pytest.mark.parametrize("operator", OPERATORS, ids=lambda operator: operator.__name__)
def test_a_broken_file_is_told_near_its_defect(operator: Operator, folder: Path) -> None:
    """There is a problem within two lines of the defect, and no exception."""
    for mutant in mutants(operator):
        path = folder / mutant.file.relative_to(ROOT)
        path.write_text(mutant.text)
        try:
            found = problems_in(str(path))
        except Exception as error:
            error.add_note(mutant.name)
            raise
        finally:
            shutil.copy(mutant.file, path)
        near = [p for p in found if p.file == str(path) and abs(p.line - mutant.line) <= NEAR]
        line = mutant.text.splitlines()[mutant.line - 1]
        assert near, f"{mutant.name}: line {mutant.line}: {line!r}: {[str(p) for p in found]}"
