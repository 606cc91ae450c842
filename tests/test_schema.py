"""The JSON Schema of trees: it is up to date, accepts what is good, and refuses what check refuses of the form."""

from __future__ import annotations

import json
import subprocess
import textwrap
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from click.testing import CliRunner
from hypothesis import given

from mpvi_bt.apps.cli.editor_schema import schema
from mpvi_bt.apps.cli.listing import list_
from mpvi_bt.executive.behaviors.registry import node_types
from mpvi_bt.executive.tree.json_schema import schema_text, tree_schema
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.executive.tree.yaml_io import dump_tree, parse_tree
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems
from mpvi_bt.ground.marked_yaml import load_marked, parse_marked
from tests import warm
from tests.tree_strategies import trees

FILE = paths.shipped() / "trees" / "schema" / "tree.json"
TREES = sorted((paths.shipped() / "trees").glob("*.yaml"))
VALIDATOR = jsonschema.Draft7Validator(tree_schema())

GOOD = """\
tree: t
about: x
parameters:
  object: text
  tries: {type: integer, default: 2, about: how often}
blackboard:
  cups: 0
root:
  sequence: s
  memory: true
  children:
    - navigate: $object
      room: kitchen
    - timeout: 90 steps
      child:
        retry: $tries
        child:
          manipulate: pick up the $object
    - subtree: go_to
      arguments: {place: $object}
    - set: cups
      add: 1
    - parallel:
      policy: success_on_one
      children:
        - look_around:
        - posture: travel
          segments: [1, 2]
"""


def refused(text: str) -> list[Any]:
    """Deepest places of what the schema says against a text."""
    found = list(VALIDATOR.iter_errors(parse_marked(text, "t.yaml")[0]))
    return [list(jsonschema.exceptions.best_match([error]).absolute_path) for error in found]


def test_the_file_is_what_the_registry_gives() -> None:
    """trees/schema/tree.json is what `mpvi schema` prints; it is a valid schema."""
    printed = CliRunner().invoke(schema, ["tree"], standalone_mode=False).stdout
    assert printed == schema_text() == FILE.read_text(), "run `mpvi schema tree > trees/schema/tree.json`"
    jsonschema.Draft7Validator.check_schema(json.loads(printed))


def test_the_schema_is_no_tree() -> None:
    """It lies beside the trees, and is not listed among them."""
    assert "schema" not in paths.names("trees")
    assert "tree" not in paths.names("trees")


@pytest.mark.parametrize("path", TREES, ids=lambda p: p.stem)
def test_shipped_trees_name_it_and_are_valid(path: Path) -> None:
    """Every tree written by hand names the schema in its first line, by a path that leads there, and conforms."""
    assert refused(path.read_text()) == []
    first = path.read_text().partition("\n")[0]
    if "schema" in first:
        assert first.startswith("# yaml-language-server: $schema=")
        assert (path.parent / first.partition("=")[2]).resolve() == FILE.resolve()


@given(tree=trees)
def test_whatever_can_be_written_is_valid(tree: TreeSpec) -> None:
    """A tree of any nodes conforms."""
    assert refused(dump_tree(tree)) == []


def test_every_node_has_help() -> None:
    """Hovering over a kind or a parameter says what it is."""
    definitions = tree_schema()["definitions"]
    for kind, node in node_types().items():
        properties = definitions[f"node-{kind}"]["properties"]
        assert node.summary in properties[kind]["description"]
        assert all("description" in value for value in properties.values()), kind


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("tree: t", "treee: t", []),
        ("about: x", "about: [x]", ["about"]),
        ("object: text", "object: txt", ["parameters", "object"]),
        ("object: text", "Object: text", ["parameters"]),
        ("type: integer", "type: int", ["parameters", "tries"]),
        ("cups: 0", "cups: [0]", ["blackboard", "cups"]),
        ("sequence: s", "sequenc: s", ["root"]),
        ("memory: true\n", "memory: maybe\n", ["root", "memory"]),
        ("  memory: true\n", "", ["root"]),
        ("room: kitchen", "rom: kitchen", ["root", "children", 0]),
        ("room: kitchen", "room: 7", ["root", "children", 0, "room"]),
        ("room: kitchen", "retry: 3", ["root", "children", 0]),
        ("room: kitchen", "child: {succeed: x}", ["root", "children", 0]),
        ("timeout: 90 steps", "timeout: 90 stps", ["root", "children", 1, "timeout"]),
        ("timeout: 90 steps", "timeout: 0", ["root", "children", 1, "timeout"]),
        ("retry: $tries", "retry: 1.5", ["root", "children", 1, "child", "retry"]),
        ("manipulate: pick up the $object", "manipulate:", ["root", "children", 1, "child", "child", "manipulate"]),
        ("arguments: {place: $object}", "arguments: [place]", ["root", "children", 2, "arguments"]),
        ("arguments: {place: $object}", "child: {succeed: x}", ["root", "children", 2]),
        ("set: cups", "set: Cups", ["root", "children", 3, "set"]),
        ("add: 1", "add: much", ["root", "children", 3, "add"]),
        ("success_on_one", "success_on_on", ["root", "children", 4, "policy"]),
        ("posture: travel", "posture: yoga", ["root", "children", 4, "children", 1, "posture"]),
        ("segments: [1, 2]", "segments: [-1]", ["root", "children", 4, "children", 1, "segments"]),
    ],
)  # fmt: skip
def test_what_check_refuses_of_the_form_is_underlined(old: str, new: str, place: list[Any]) -> None:
    """Each defect that one file shows by itself is refused by both, and by the schema in its place."""
    assert refused(GOOD) == []
    assert GOOD.count(old) == 1
    broken = GOOD.replace(old, new)
    with pytest.raises(FileProblems):
        parse_tree(broken, "t.yaml")
    found = refused(broken)
    assert found
    assert all(at[: len(place)] == place or place[: len(at)] == at for at in found)
    assert place in [at[: len(place)] for at in found]


def test_references_may_stand_for_any_value() -> None:
    """$name and ${name} are valid where a number is due, other text is not."""
    assert refused(GOOD.replace("timeout: 90 steps", "timeout: ${limit}")) == []
    assert refused(GOOD.replace("timeout: 90 steps", "timeout: about $limit")) != []


def test_rules_have_a_schema() -> None:
    """`mpvi schema rules` is valid and accepts the rules of the examples, but no rule without its nodes."""
    found = json.loads(CliRunner().invoke(schema, ["rules"], standalone_mode=False).stdout)
    jsonschema.Draft7Validator.check_schema(found)
    validator = jsonschema.Draft7Validator(found)
    for path in sorted((paths.shipped() / "examples").glob("*.yaml")):
        if "substitute" not in (data := load_marked(path)[0]):
            continue
        assert validator.is_valid(data), path
        del data["substitute"][0]["nodes"]
        assert not validator.is_valid(data)


PLUGIN = """\
from typing import Annotated, Literal

from pydantic import Field

from mpvi_bt.executive.behaviors.parameters import Parameters
from mpvi_bt.executive.behaviors.registry import NodeType


class Tune(Parameters):
    "The tune, and how loud it is."

    tune: Literal["waltz", "tango"]
    volume: Annotated[int, Field(ge=0, le=11)] = 5


NODES = [NodeType("whistle", "leaf", Tune, "tune", "whistling:Whistle", "Whistles a tune.", robot=True)]
"""


@pytest.fixture
def plugin(tmp_path: Path) -> Path:
    """A folder with an installed package that adds a node by entry point."""
    (tmp_path / "whistling.py").write_text(PLUGIN)
    info = tmp_path / "whistling-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: whistling\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[mpvi_bt.behaviors]\nwhistling = whistling:NODES\n")
    return tmp_path


def mpvi(plugin: Path, *args: str) -> subprocess.CompletedProcess[str]:
    """`mpvi` where that package is installed."""
    code = f"import sys; sys.path.insert(0, {str(plugin)!r}); from mpvi_bt.apps.cli import main; main()"
    return warm.python("-c", code, *args, cwd=plugin)


def test_a_package_adds_nodes_by_entry_point(plugin: Path) -> None:
    """What it adds is listed, checked, formatted, drawn and in the schema, like our own."""
    text = "tree: t\nroot:\n  whistle: waltz\n  volume: 11\n"
    (plugin / "t.yaml").write_text(text)
    assert mpvi(plugin, "check", "t.yaml").stdout == ""
    assert mpvi(plugin, "fmt", "--check", "t.yaml").returncode == 0
    assert "whistle waltz" in mpvi(plugin, "render", "t.yaml").stdout
    listed = json.loads(mpvi(plugin, "list", "nodes", "--json").stdout)
    assert listed["whistle"] == {
        "family": "leaf",
        "headline": "tune",
        "parameters": {"tune": True, "volume": False},
        "summary": "Whistles a tune.",
    }
    validator = jsonschema.Draft7Validator(json.loads(mpvi(plugin, "schema").stdout))
    assert validator.is_valid(load_marked(plugin / "t.yaml")[0])
    for wrong, line in (("volume: 12", 4), ("volum: 1", 4), ("child: {succeed: x}", 4)):
        (plugin / "t.yaml").write_text(text.replace("volume: 11", wrong))
        assert f"t.yaml:{line}:" in mpvi(plugin, "check", "t.yaml").stdout
        assert not validator.is_valid(load_marked(plugin / "t.yaml")[0])


def test_a_broken_package_is_told_in_one_line(plugin: Path) -> None:
    """An entry point that does not load names itself; there is no traceback."""
    (plugin / "whistling.py").write_text("NODES = 1 / 0\n")
    (plugin / "t.yaml").write_text("tree: t\nroot:\n  succeed: x\n")
    done = mpvi(plugin, "check", "t.yaml")
    assert (done.returncode, "Traceback" in done.stderr) == (1, False)
    assert "entry point 'whistling' of mpvi_bt.behaviors in package 'whistling': ZeroDivisionError" in done.stdout


def test_our_nodes_are_listed_with_their_parameters() -> None:
    """`mpvi list nodes` has a line for every kind, within 80 columns."""
    shown = CliRunner().invoke(list_, ["nodes"], standalone_mode=False).stdout
    assert all(len(line) <= 80 for line in shown.splitlines())
    words = " ".join(textwrap.dedent(shown).split())
    assert "Drives the base to a named target. (leaf, target, [room], [elsewhere: true or false])" in words
    assert {line.split()[0] for line in shown.splitlines() if line[0] != " "} == set(node_types())
