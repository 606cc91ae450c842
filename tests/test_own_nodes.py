"""Nodes of a user's own, in a file beside a tree or at an import path: every command finds them, in that tree alone."""

from __future__ import annotations

import json
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import jsonschema
import pytest

from mpvi_bt.apps import api
from mpvi_bt.apps.authoring.checking import problems_in
from mpvi_bt.apps.cli.group import run
from mpvi_bt.apps.mcp_server.run_processes import RunProcesses
from mpvi_bt.apps.mcp_server.tools import Tools
from mpvi_bt.apps.watch.dry_page import drawn
from mpvi_bt.executive.behaviors.own_nodes import own_nodes
from mpvi_bt.executive.btcpp.export import to_xml
from mpvi_bt.executive.ticking.dry import dry_tree, run_dry
from mpvi_bt.executive.trace.read import read_trace
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.json_schema import tree_schema
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.executive.tree.yaml_io import dump_tree, expanded, from_expanded, load_tree, parse_tree
from mpvi_bt.ground.errors import FileProblems, UserError
from mpvi_bt.ground.marked_yaml import load_marked
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.recording.recorder import Recorder

NODES = '''
from __future__ import annotations
from pathlib import Path
from typing import Literal
from py_trees.common import Status
from mpvi_bt.executive.behaviors.node import Decorator, Leaf

Path(__file__).with_name("imported").touch()

class Blink(Leaf):
    """Blinks a lamp."""
    def __init__(self, name: str, times: int = 3, color: Literal["red", "green"] = "red", lamp: str | None = None):
        super().__init__(name)
        self.times, self.color, self.lamp = times, color, lamp
    def initialise(self):
        super().initialise()
        self.left = self.times
    def update(self):
        self.left -= 1
        self.feedback_message = f"{self.color} {self.left}"
        return Status.RUNNING if self.left else Status.SUCCESS

class AtNight(Decorator):
    """As its child."""

class CallHome(Leaf):
    needs_robot = True
    def update(self):
        raise OSError("no robot")
'''
TREE = """\
tree: lamps
nodes: my_nodes.py  # beside it
root:
  sequence:
  memory: true
  children:
    - blink: 2
      color: green
    - at_night: late
      child:
        blink:
    - call_home:
"""


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A tree with a file of nodes beside it, in a folder that is not the current one."""
    folder = tmp_path / "mine" / "trees"
    folder.mkdir(parents=True)
    (folder / "my_nodes.py").write_text(NODES)
    (folder / "lamps.yaml").write_text(TREE)
    return folder / "lamps.yaml"


def test_every_command_finds_nodes_beside_a_tree(
    tree: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is checked, formatted, drawn, converted and run, by its file and by its name in a folder of MPVI_PATH."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPVI_PATH", str(tree.parent.parent))
    for given in (str(tree), "lamps"):
        for words in (["check"], ["render"], ["render", "--format", "svg", "--out", "x.svg"], ["convert"]):
            assert run([words[0], given, *words[1:]]) == 0, capsys.readouterr().err
        assert run(["run", "--dry", "--tree", given, "--out", str(tmp_path / given.replace("/", "_"))]) == 0
    assert run(["fmt", "--check", str(tree)]) == 0
    assert "blink 2" in capsys.readouterr().out
    page = drawn(TREE, str(tree), str(tmp_path))
    assert "green 0" in page


def test_the_schema_has_them(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`mpvi schema --nodes FILE` takes a tree with its nodes, and refuses their parameters where these are wrong."""
    assert run(["schema", "--nodes", str(tree.with_name("my_nodes.py"))]) == 0
    validator = jsonschema.Draft7Validator(json.loads(capsys.readouterr().out))
    assert validator.is_valid(load_marked(tree)[0])
    tree.write_text(TREE.replace("green", "blue"))
    assert not validator.is_valid(load_marked(tree)[0])
    assert not jsonschema.Draft7Validator(tree_schema()).is_valid(load_marked(tree)[0])


def prepared_kinds(tree: str) -> list[str]:
    """Runs in a process of its own, as the workers of suites do."""
    from mpvi_bt.runs.episode.prepare import prepare

    spec = prepare(EpisodeConfig("", tree=tree)).spec
    return sorted(type(node).__name__ for node in Tree(spec).nodes.values())


def test_worker_processes_find_them(tree: Path) -> None:
    """A process that gets the episode's settings alone, as those of suites do, reads and builds the tree."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        assert pool.submit(prepared_kinds, str(tree)).result() == ["AtNight", "Blink", "Blink", "CallHome", "Sequence"]


def test_an_import_path_names_a_class(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of what is installed or in the current folder; only that class is a node then."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    (tmp_path / "flashing.py").write_text(NODES)
    spec = parse_tree("tree: t\nnodes: [flashing:Blink]\nroot:\n  blink: 2\n")
    assert run_dry(dry_tree(spec)).ending == "success"
    with pytest.raises(FileProblems, match="unknown node 'at_night'"):
        parse_tree("tree: t\nnodes: [flashing:Blink]\nroot:\n  at_night: x\n  child: {blink: 2}\n")


def test_a_subtree_brings_its_own(tree: Path) -> None:
    """Its nodes are known in its file alone; the tree that calls it runs with them."""
    outer = tree.with_name("outer.yaml")
    outer.write_text("tree: outer\nroot:\n  subtree: lamps\n")
    assert run_dry(dry_tree(load_tree(outer))).ending == "success"
    outer.write_text("tree: outer\nroot:\n  sequence:\n  memory: true\n  children: [{subtree: lamps}, {blink: 1}]\n")
    with pytest.raises(FileProblems, match="unknown node 'blink'"):
        load_tree(outer)


def test_two_nodes_of_one_name_are_refused(tree: Path) -> None:
    """A tree with its subtrees has one node of a name, and none of the name of one of ours."""
    (tree.parent / "other.py").write_text(NODES)
    outer = tree.with_name("outer.yaml")
    outer.write_text(
        "tree: outer\nnodes: other.py\nroot:\n  sequence:\n  memory: true\n  children: [{blink: 1}, {subtree: lamps}]\n"
    )
    with pytest.raises(FileProblems, match=r"a node 'blink' is of .*other.py:Blink already"):
        load_tree(outer)
    (tree.parent / "my_nodes.py").write_text(
        "from mpvi_bt.executive.behaviors.node import Leaf\nclass Say(Leaf):\n    pass\n"
    )
    with pytest.raises(FileProblems, match="a node 'say' is there already"):
        load_tree(tree)


def test_an_edited_file_is_read_again(tree: Path) -> None:
    """In a process that goes on, such as that of `mpvi edit`, the nodes are those of the file as it is now."""
    assert load_tree(tree)
    (tree.parent / "my_nodes.py").write_text(NODES.replace("green", "white"))
    with pytest.raises(FileProblems, match="'green'"):
        load_tree(tree)


def test_a_tree_is_written_as_it_was_read(tree: Path) -> None:
    """`nodes:` included."""
    spec = load_tree(tree)
    tree.write_text(dump_tree(spec))
    assert load_tree(tree) == spec
    assert load_tree(tree).own_nodes == ("my_nodes.py",)


def test_a_trace_is_read_without_their_code(tree: Path, tmp_path: Path) -> None:
    """It tells of them all that is drawn; reading it imports nothing. What is read can be built where the file is."""
    spec = load_tree(tree)
    file = tmp_path / "t.jsonl"
    run_dry(dry_tree(spec), subscribers=[Recorder(file)])
    again = from_expanded(json.loads(json.dumps(expanded(spec))))
    assert [type(node).__name__ for node in Tree(again).nodes.values()] == [
        "Sequence", "Blink", "AtNight", "Blink", "CallHome"
    ]  # fmt: skip
    (tree.parent / "my_nodes.py").write_text("raise SystemExit('never')")
    labels = [placed.spec.label for placed in read_trace(file).tree.nodes]
    assert labels == ["sequence", "blink 2", "at night: late", "blink 3", "call home"]


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("import no_such_thing\n", r"ModuleNotFoundError: No module named 'no_such_thing' \(.*my_nodes.py:1\)"),
        ("x = 1\ny = x +\n", r"SyntaxError: invalid syntax \(.*my_nodes.py:2:8\)"),
        ("\n1 / 0\n", r"ZeroDivisionError: division by zero \(.*my_nodes.py:2\)"),
        ("import sys\nsys.exit(0)\n", r"SystemExit: 0 \(.*my_nodes.py:2\)"),
        ("open('/no/such/file')\n", r"FileNotFoundError: .* \(.*my_nodes.py:1\)"),
        ("x = 1\n", "my_nodes.py: holds no node"),
        (NODES.replace("times: int = 3", "times"), "parameter 'times' of Blink has no type"),
        (NODES.replace("times: int = 3", "times: list = []"), "parameter 'times' of Blink is .*list"),
    ],
)
def test_a_file_that_cannot_be_imported_is_told_with_both_places(tree: Path, code: str, said: str) -> None:
    """One problem, at the item of the tree's file, says what is wrong and where in the file of nodes."""
    (tree.parent / "my_nodes.py").write_text(code)
    (problem,) = problems_in(str(tree))
    assert (problem.line, problem.column, problem.code) == (2, 8, "own-node")
    with pytest.raises(FileProblems, match=said):
        load_tree(tree)


@pytest.mark.parametrize("given", ["../my_nodes.py", "/tmp/my_nodes.py", "a/../../my_nodes.py", "my_nodes", "http://x"])
def test_no_file_elsewhere_is_imported(tree: Path, given: str) -> None:
    """Only files in the tree's folder or below it, and import paths."""
    with pytest.raises(UserError):
        own_nodes(given, tree.parent)
    assert not (tree.parent / "imported").exists()


def test_clients_bring_no_code(tree: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A tree that an MCP client sends cannot have nodes of its own: nothing is imported."""
    monkeypatch.chdir(tree.parent)
    tools = Tools(RunProcesses(tmp_path))
    for use in (tools.check, tools.preview, lambda text: tools.run(tree=text)):
        with pytest.raises(UserError, match="cannot bring code"):
            use(TREE)
    assert not (tree.parent / "imported").exists()


def test_python_finds_them(tree: Path) -> None:
    """`mpvi_bt.load_tree` does."""
    assert isinstance(api.load_tree(tree), TreeSpec)


def test_btcpp_is_told_of_them(tree: Path) -> None:
    """The XML has their models with their ports."""
    text = to_xml(load_tree(tree)).xml
    assert '<Blink times="2" color="green" />' in text
    assert '<Action ID="Blink">' in text
