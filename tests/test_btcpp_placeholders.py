"""Leaves that nobody knows here become stand-ins: kinds with their ports, and a module for the user to fill in."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from pathlib import Path
from xml.sax.saxutils import quoteattr

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.apps.cli.convert import convert
from mpvi_bt.executive.btcpp.export import to_xml
from mpvi_bt.executive.btcpp.importing import from_xml
from mpvi_bt.executive.tree.yaml_io import dump_tree, load_tree
from mpvi_bt.ground.errors import FileProblems, UserError
from tests import warm
from tests.test_btcpp import main_tree

XML = """<root BTCPP_format="4" main_tree_to_execute="Main">
<BehaviorTree ID="Main"><Sequence>
<DetectObject name="look" what="the $cup" object="{found}"/>
<OpenGripper width="0.1"/>
<SubTree ID="Lift" thing="{found}" effort="5"/>
<Count total="{n}"/>
<ScriptCondition code="n &lt; 3"/>
<Say text="{found}"/>
</Sequence></BehaviorTree>
<BehaviorTree ID="Lift"><GraspIt thing="{thing}" effort="{effort}" Force-Max="3"/></BehaviorTree>
<TreeNodesModel>
<Action ID="Count"><output_port name="total" type="int"/></Action>
<Action ID="OpenGripper"><input_port name="width" type="double"/><input_port name="speed" default="0.5"/></Action>
</TreeNodesModel></root>"""
MAIN = """
tree: Main
nodes: [own_nodes.py]
blackboard:
  found: found
  n: 0
root:
  sequence:
  memory: true
  children:
    - detect_object: look
      what: the $$cup
      object: found
    - open_gripper:
      width: 0.1
    - subtree: Lift
      arguments: {effort: 5, thing: $found}
    - count:
      total: n
    - test: n
      not_equals: 3
      at_most: 3
    - say: $found
"""


def mpvi(*words: object, folder: Path) -> subprocess.CompletedProcess[str]:
    """The command in a process of its own."""
    return run("from mpvi_bt.apps.cli import main; main()", *map(str, words), folder=folder)


def run(code: str, *words: str, folder: Path) -> subprocess.CompletedProcess[str]:
    return warm.python("-c", code, *words, cwd=folder)


@pytest.fixture
def converted(tmp_path: Path) -> Path:
    """A folder with what `mpvi convert --placeholders` wrote."""
    (tmp_path / "own.xml").write_text(XML)
    done = CliRunner().invoke(convert, [str(tmp_path / "own.xml"), str(tmp_path / "own.yaml"), "--placeholders"])
    assert done.exit_code == 0, done.exception
    assert f"wrote {tmp_path / 'own_nodes.py'} too: your nodes, to be written" in done.stderr
    return tmp_path


def test_what_is_converted_can_be_checked_and_run_dry(converted: Path) -> None:
    """With the module beside it, in another process; what each node does is still to be written."""
    assert (converted / "own.yaml").read_text() == MAIN.lstrip()
    checked = mpvi("check", "own.yaml", folder=converted)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    ran = mpvi("run", "--dry", "--tree", "own.yaml", folder=converted)
    assert ran.returncode == 0, ran.stdout + ran.stderr


def test_a_stand_in_fails_until_it_is_written(converted: Path) -> None:
    """A run with a robot says which class to write; a dry run is no proof that anything is done."""
    code = (
        "from mpvi_bt.testing import KinematicWorld, scripted_context\n"
        "from mpvi_bt.executive.tree.build import Tree\nfrom mpvi_bt.executive.tree.yaml_io import load_tree\n"
        "tree = Tree(load_tree('own.yaml'))\ntree.setup(scripted_context(KinematicWorld(), {}, {}, {}))\n"
        "print(tree.tick().name)\n"
        "[print(n.failure.reason, n.failure.evidence) for n in tree.nodes.values() if n.failure]"
    )
    done = run(code, folder=converted)
    assert done.stdout.startswith("FAILURE")
    assert "not_written write DetectObjectNode.update in own_nodes.py" in done.stdout


def test_the_module_is_in_the_style_of_the_project(converted: Path) -> None:
    """Formatted, and without a fault that ruff finds."""
    for words in (["format", "--check"], ["check", "--select", "E,F,W,I"]):
        done = subprocess.run(
            [sys.executable, "-m", "ruff", *words, "--line-length", "120", str(converted / "own_nodes.py")],
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr


def test_without_the_option_the_message_names_it() -> None:
    """Of each leaf; a node with children has no stand-in."""
    with pytest.raises(FileProblems) as caught:
        from_xml(main_tree("<Sequence><OpenGripper/><IsBatteryLow/><Around><AlwaysSuccess/></Around></Sequence>"))
    told = [p.message for p in caught.value.problems]
    assert ["with --placeholders it becomes a stand-in" in message for message in told] == [True, True, False]
    with pytest.raises(FileProblems, match="unknown node 'Around'"):
        from_xml(main_tree("<Around><AlwaysSuccess/></Around>"), placeholders="own_nodes")


def test_a_module_that_is_there_is_kept(converted: Path) -> None:
    """What the user has written in it is never lost, not even by --force."""
    (converted / "own_nodes.py").write_text("mine")
    for more in ([], ["--force"]):
        words = [str(converted / "own.xml"), str(converted / "own.yaml"), "--placeholders", *more]
        done = CliRunner().invoke(convert, words)
        assert done.exit_code == 0
        assert "is there already: it must have the nodes of the tree" in done.stderr
        assert (converted / "own_nodes.py").read_text() == "mine"


def test_programs_get_the_module_too(converted: Path) -> None:
    """In the JSON; without OUT a tree and a module are no one text."""
    words = [str(converted / "own.xml"), "--placeholders"]
    told = json.loads(CliRunner().invoke(convert, [*words, "--json"]).stdout)
    assert told["module"] == (converted / "own_nodes.py").read_text()
    assert isinstance(CliRunner().invoke(convert, words).exception, UserError)
    assert isinstance(CliRunner().invoke(convert, ["hello", "--placeholders"]).exception, UserError)


@pytest.mark.parametrize("elsewhere", ['<MoveTo goal="kitchen"/>', '<SubTree ID="Visit" goal="{place}"/>'])
def test_a_port_that_takes_a_text_or_what_a_call_fills_is_no_output(elsewhere: str) -> None:
    """A file without models: what such a port names first is for the user to set, as `goal` of every `MoveTo` is."""
    main = f'<BehaviorTree ID="Main"><Sequence><MoveTo goal="{{place}}"/>{elsewhere}</Sequence></BehaviorTree>'
    visit = '<BehaviorTree ID="Visit"><MoveTo goal="{goal}"/></BehaviorTree>'
    xml = f'<root BTCPP_format="4" main_tree_to_execute="Main">{main}{visit}</root>'
    imported = from_xml(xml, "x.xml", placeholders="own_nodes.py")
    assert not [one for one in imported.warnings if one.code == "btcpp-output"]
    assert "parameters:\n  place: text\n" in dump_tree(imported.main)
    assert "goal: $place" in dump_tree(imported.main)


def test_an_output_is_a_key() -> None:
    """As the file declares, or as nothing else sets it, which is told; anything but a key is refused at its place."""
    imported = from_xml(XML, "own.xml", placeholders="own_nodes")
    told = [(p.line, p.column) for p in imported.warnings if p.code == "btcpp-output"]
    assert told == [(3, 43)]
    assert imported.main.root.children[0].type.writes == ("object",)
    for text in ("three", "{Three}"):
        with pytest.raises(FileProblems) as caught:
            from_xml(XML.replace('total="{n}"', f'total="{text}"'), "own.xml", placeholders="own_nodes")
        assert [(p.line, p.column, p.code) for p in caught.value.problems] == [(6, 8, "port-value")]


def test_a_default_that_means_nothing_is_refused() -> None:
    """Where it is declared."""
    with pytest.raises(FileProblems) as caught:
        from_xml(XML.replace('default="0.5"', 'default="{Bad}"'), "own.xml", placeholders="own_nodes")
    assert [(p.line, p.column, p.code) for p in caught.value.problems] == [(13, 91, "port-value")]


def test_placeholders_survive_the_way_there_and_back() -> None:
    """As custom nodes, with their names and ports."""
    main = from_xml(XML, placeholders="own_nodes").main
    xml = to_xml(main).xml
    assert '<Action ID="DetectObject">' in xml
    back = from_xml(xml, placeholders="own_nodes").main
    assert [(n.path, n.spec.kind) for n in back.nodes] == [(n.path, n.spec.kind) for n in main.nodes]


_words = st.from_regex("[A-Za-z][A-Za-z0-9_-]{0,6}", fullmatch=True) | st.sampled_from(
    [
        "name",
        "child",
        "Wait",
        "wait",
        "class",
        "self",
        "Node",
        "Key",
        "Leaf",
        "Value",
        "Status",
        "NODES",
        "a-b",
        "a_b",
        "aB",
    ]
)
_values = st.sampled_from(["{a}", "{b}", "{=}", "3", "0.5", "true", "a $b", "", '"', "'", "\\", "{Bad}", "é\n"])


@given(st.lists(st.tuples(_words, st.dictionaries(_words, _values, max_size=3)), min_size=1, max_size=4))
def test_whatever_a_leaf_is_called_it_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, nodes: list[tuple[str, dict[str, str]]]
) -> None:
    """No name breaks the module, and no value is lost: the tree is the one that its YAML says."""
    made = (f"<{tag} {' '.join(f'{k}={quoteattr(v)}' for k, v in ports.items())}/>" for tag, ports in nodes)
    with contextlib.suppress(FileProblems):
        imported = from_xml(main_tree(f"<Sequence>{''.join(made)}</Sequence>"), "t.xml", placeholders="own_nodes")
        main = imported.main
        assert len(main.root.children) == len(nodes)
        if main.own_nodes:
            folder = tmp_path_factory.mktemp("trees")
            (folder / "own_nodes.py").write_text(imported.module)
            (folder / "t.yaml").write_text(dump_tree(main))
            assert dump_tree(load_tree(folder / "t.yaml")) == dump_tree(main)
