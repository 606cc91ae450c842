"""Trees as data: compiling plans, YAML both ways, drawing."""

from __future__ import annotations

import itertools
import string
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.executive.behaviors.parameters import (
    CriterionToCheck,
    Limit,
    MemoryFlag,
    NavigateTo,
    NoParameters,
    Prompt,
    Value,
)
from mpvi_bt.executive.behaviors.references import fill, resolve
from mpvi_bt.executive.behaviors.registry import node_type, node_types
from mpvi_bt.executive.drawing.text import ascii_tree
from mpvi_bt.executive.plan.planners import RecordedPlanner
from mpvi_bt.executive.plan.schema import Manipulation, Navigation, Plan
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.tree.compile import MANIPULATION_TIMEOUT_S, compile_plan
from mpvi_bt.executive.tree.lint import lint
from mpvi_bt.executive.tree.spec import NodeSpec, TreeSpec
from mpvi_bt.executive.tree.state import NodeState, Status
from mpvi_bt.executive.tree.yaml_io import dump_tree, expanded, from_expanded, load_tree, parse_tree
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems, UnknownName
from tests.test_plan import plans
from tests.tree_strategies import trees

SKILLS = load_skills()
TREES = sorted((paths.shipped() / "trees").glob("*.yaml"))
GOLDEN = Path(__file__).parent / "golden"


@given(tree=trees)
def test_yaml_is_lossless(tree: TreeSpec) -> None:
    """Writing a tree and reading it gives the same tree, and writing that the same text."""
    text = dump_tree(tree)
    read = parse_tree(text)
    assert read == tree
    assert dump_tree(read) == text


@given(tree=trees, width=st.integers(40, 120), status=st.sampled_from(["RUNNING", "SUCCESS", "FAILURE", "INVALID"]))
def test_drawing_keeps_its_width(tree: TreeSpec, width: int, status: Status) -> None:
    """Every node gets one line, none longer than asked, whatever the labels and the feedback."""
    state = NodeState(status, "some rather long feedback that goes on", 1.0, 60.0)
    lines = ascii_tree(tree, {n.path: state for n in tree.nodes}, width).splitlines()
    assert len(lines) == len(tree.nodes)
    assert max(map(len, lines)) <= width


@given(tree=trees)
def test_paths_are_unique(tree: TreeSpec) -> None:
    """No two nodes share a path, and every child's path begins with its parent's."""
    found = [n.path for n in tree.nodes]
    assert len(set(found)) == len(found)
    assert all(child.startswith(n.path + "/") for n in tree.nodes for child in n.children)


def test_names_with_a_number_do_not_take_another_path() -> None:
    """Siblings called step, step and step#2 have three paths."""
    names = ["step", "step", "step#2", "step"]
    root = NodeSpec(
        "sequence", MemoryFlag(memory=True), "s", tuple(NodeSpec("succeed", NoParameters(), n) for n in names)
    )
    assert TreeSpec("t", root).nodes[0].children == ("s/step", "s/step#2", "s/step#2#2", "s/step#3")


class Board(dict[str, Value]):
    """A blackboard that has every key."""

    def __missing__(self, key: str) -> str:
        return f"<{key} $object>"


pieces = st.sampled_from(["$", "$$", "$cup", "${cup}", "$object", "${object}", "s", " ", "5$", "the "])


@given(text=st.lists(pieces, max_size=6).map("".join), value=st.lists(pieces, max_size=4).map("".join))
def test_filling_in_reads_nothing_twice(text: str, value: str) -> None:
    """A parameter's text says beside other text what it says alone: its references, and its own dollar signs."""
    filled = str(fill(text, {"object": value}))
    assert resolve(filled, Board()) == resolve(text, Board(object=resolve(value, Board())))


def test_a_plan_refers_to_nothing() -> None:
    """A dollar sign in a plan stays one, in prompts, targets, criteria and names, also through YAML."""
    text = "pick up the $five ${bill} for $$"
    parts = {"description": text, "completion_criterion": text}
    plan = Plan.model_validate(
        {
            "task_name": "t",
            "segments": [
                {"type": "navigation", **parts, "target": text},
                {"type": "manipulation", **parts},
            ],
        }
    )
    tree = compile_plan(plan, SKILLS)
    assert [unit.name for unit in tree.root.children] == [f"1 {text}", f"2 {text}"]
    assert parse_tree(dump_tree(tree)) == tree
    assert not lint(parse_tree(dump_tree(tree)), None)
    manipulate, check = tree.root.children[1].children[0].children[0].children
    for said in (manipulate.parameters.prompt, check.parameters.criterion):  # type: ignore[attr-defined]
        assert resolve(said, {}) == text


def test_the_longest_plan_compiles_and_is_written() -> None:
    """200 segments with the longest phrases, all dollar signs, give a tree that is read back."""
    long = {"type": "manipulation", "description": "$" * 300, "completion_criterion": "$" * 300}
    tree = compile_plan(Plan.model_validate({"task_name": "t", "segments": [long] * 200}), SKILLS)
    assert parse_tree(dump_tree(tree)) == tree
    assert from_expanded(expanded(tree)) == tree


def test_keys_of_a_subtree_stay_in_its_file(tmp_path: Path) -> None:
    """A tree has the keys that its subtrees declare, and writing it leaves them to their files."""
    (tmp_path / "inner.yaml").write_text("tree: inner\nblackboard: {cups: 1}\nroot: {say: $cups}\n")
    (tmp_path / "outer.yaml").write_text(
        "tree: outer\nparameters: {drinks: {type: text, default: a}}\nroot: {subtree: inner}\n"
    )
    tree = load_tree(tmp_path / "outer.yaml")
    assert tree.blackboard == {"cups": 1}
    assert "cups" not in dump_tree(tree)
    assert from_expanded(expanded(tree)).blackboard == {"cups": 1}


@given(plan=plans)
def test_every_segment_is_in_one_unit_in_order(plan: object) -> None:
    """The units of a compiled tree cover the plan's segments once each, navigation alone, manipulation in groups."""
    assert isinstance(plan, Plan)
    units = compile_plan(plan, SKILLS).root.children
    assert [i for unit in units for i in unit.segments] == list(range(len(plan.segments)))
    for unit in units:
        kinds = {type(plan.segments[i]) for i in unit.segments}
        assert len(kinds) == 1
        assert kinds == {Manipulation} or len(unit.segments) == 1
    for one, next_ in itertools.pairwise(units):
        assert Navigation in {type(plan.segments[u.segments[0]]) for u in (one, next_)}


def test_a_group_joins_descriptions_and_ends_as_its_last_segment() -> None:
    """Prompt, criterion, skill and time of a group come from the right segments."""
    tree = compile_plan(RecordedPlanner().plan("picking_up_trash"), SKILLS)
    attempt = tree.root.children[3]
    timeout = attempt.children[0]
    manipulate, check = timeout.children[0].children
    assert isinstance(manipulate.parameters, Prompt)
    assert manipulate.parameters.prompt == (
        "pick up a can of soda with the right hand, then put the can of soda in the trash can"
    )
    assert check.parameters == CriterionToCheck(criterion="a can of soda is in the trash can", skill="place_in")
    assert timeout.parameters == Limit(limit=SKILLS["pick"].timeout_s + SKILLS["place_in"].timeout_s)
    assert (attempt.segments, check.segments) == ((3, 4), (4,))


def test_what_a_description_says_of_a_target_is_driven_to() -> None:
    """Language models leave it out of the target, as they are told to name that in few words."""
    for description, target in (
        ("go to another cup", "another cup"),
        ("go to the last cup", "another cup"),
        ("go to the cup next to the other plate", "cup"),
        ("go to a cup", "cup"),
        ("go to the outlast cup", "cup"),
        ("go to the other cupboard", "cup"),
        ("go to an empty cup", "empty cup"),
        ("go to the other empty cup", "another empty cup"),
        ("go to the open cup", "open cup"),
        ("go to another closed cup", "another closed cup"),
        ("go to the cup with the pens", "cup with the pens"),
        ("go to a cup without a pen", "cup without a pen"),
        ("go to the cupboard with the pens", "cup"),
    ):
        going = Navigation(
            type="navigation", description=description, completion_criterion="the robot is at a cup", target="cup"
        )
        tree = compile_plan(Plan(task_name="cups", instruction="Go.", segments=(going,)), {})
        assert tree.root.children[0].children[0].children[0].parameters == NavigateTo(target=target)


def test_without_a_skill_the_default_time_and_all_triggers_hold() -> None:
    """A manipulation that no skill covers is compiled all the same."""
    tree = compile_plan(RecordedPlanner().plan("picking_up_trash"), {})
    timeout = tree.root.children[1].children[0]
    assert timeout.parameters == Limit(limit=MANIPULATION_TIMEOUT_S)
    assert timeout.children[0].children[1].parameters == CriterionToCheck(
        criterion="the trash can is held in a gripper"
    )


def test_the_shipped_tree_is_the_compiled_plan() -> None:
    """trees/picking_up_trash.yaml is what compiling its plan gives."""
    tree = compile_plan(RecordedPlanner().plan("picking_up_trash"), SKILLS)
    assert load_tree(paths.find("trees", "picking_up_trash"), SKILLS) == tree


@pytest.mark.parametrize("path", TREES, ids=lambda p: p.stem)
def test_shipped_trees_load_and_draw(path: Path) -> None:
    """Every shipped tree is valid, in canonical form, and 80 columns wide at most."""
    tree = load_tree(path, SKILLS)
    assert max(map(len, ascii_tree(tree).splitlines())) <= 80
    assert load_tree(path) == parse_tree(dump_tree(tree))


def test_drawing_is_golden() -> None:
    """The picture of picking_up_trash half-way is the recorded one."""
    tree = load_tree(paths.find("trees", "picking_up_trash"))
    states = {n.path: NodeState() for n in tree.nodes}
    top, first, second = tree.nodes[0], *[n for n in tree.nodes if n.depth == 1][:2]
    states[top.path] = NodeState("RUNNING")
    states[first.path] = NodeState("SUCCESS", "gave up: no_path", gave_up=True)
    states[first.children[0]] = NodeState("FAILURE", "", 4.0, 120.0)
    states[first.children[0] + "/navigate"] = NodeState("FAILURE", "no_path: the door of the kitchen is shut")
    states[second.path] = NodeState("RUNNING")
    states[second.children[0]] = NodeState("RUNNING", "", 12.34, 90.0)
    states[second.children[0] + "/until_complete"] = NodeState("RUNNING")
    states[second.children[0] + "/until_complete/manipulate"] = NodeState("RUNNING")
    states[second.children[0] + "/until_complete/check_complete"] = NodeState("RUNNING", "asked 1: no, it is empty")
    drawn = ascii_tree(tree, states) + "\n\n" + ascii_tree(tree, states, fold=True) + "\n"
    assert drawn == (GOLDEN / "picking_up_trash.txt").read_text()


GOOD = """\
tree: t
root:
  sequence: s
  memory: true
  children:
    - navigate: cup
      room: kitchen
    - timeout: 5
      child:
        manipulate: pick up the cup
"""


@pytest.mark.parametrize(
    ("old", "new", "line", "code", "says"),
    [
        ("navigate:", "navigat:", 6, "unknown-node", "Did you mean 'navigate'"),
        ("room:", "rom:", 7, "unknown-key", "Did you mean 'room'"),
        ("memory: true", "memory: maybe", 4, "wrong-type", "maybe"),
        ("  memory: true\n", "", 3, "missing-key", "'memory'"),
        ("timeout: 5", "timeout: -5", 8, "invalid-value", "above 0"),
        ("timeout: 5", "timeout: '5'", 8, "invalid-value", "seconds"),
        ("timeout: 5", "timeout: .nan", 8, "invalid-value", "seconds"),
        ("      child:", "      children:", 9, "children", "it takes 'child'"),
        ("manipulate: pick up the cup", "{}", 10, "node", "a node is a mapping"),
        ("manipulate: pick up the cup", "manipulate:", 10, "wrong-type", "should be text"),
        ("      room: kitchen", "      room: kitchen\n      child:\n        navigate: x", 8, "children", "takes none"),
        ("      room: kitchen", "      target: cup", 7, "duplicate-key", "already given"),
        ("      room: kitchen", "      timeout: 3", 7, "two-nodes", "second node type"),
        ("- navigate: cup\n      room: kitchen", "- room: kitchen\n      navigate: cup", 7, "order", "first key"),
        ("tree: t", "treee: t", 1, "unknown-key", "Did you mean 'tree'"),
        ("root:", "rot:", 2, "unknown-key", "Did you mean 'root'"),
        ("manipulate: pick", "check_complete: x\n        skill: pik\n        # pick", 11, "unknown-skill", "'pick'"),
        ("      room: kitchen", "      segments: [-1]", 7, "out-of-range", "-1"),
    ],
)  # fmt: skip
def test_a_defect_is_named_in_its_place(old: str, new: str, line: int, code: str, says: str) -> None:
    """Each defect gives a problem on its own line that says what would be valid."""
    parse_tree(GOOD, "t.yaml", SKILLS)
    assert old in GOOD
    with pytest.raises(FileProblems) as caught:
        parse_tree(GOOD.replace(old, new, 1), "t.yaml", SKILLS)
    found = [p for p in caught.value.problems if (p.line, p.code) == (line, code)]
    assert found, str(caught.value)
    assert says in found[0].message


def test_problems_below_an_unknown_node_are_found_too() -> None:
    """A misspelt kind does not hide what is wrong beneath it."""
    with pytest.raises(FileProblems) as caught:
        parse_tree(GOOD.replace("sequence: s", "sequenc: s").replace("navigate: cup", "nvigate: cup"))
    assert [p.line for p in caught.value.problems] == [3, 6]


@given(st.text(string.printable, max_size=12), st.integers(0, len(GOOD)), st.integers(0, 6))
def test_no_edit_of_a_tree_gets_a_traceback(inserted: str, at: int, removed: int) -> None:
    """Whatever is typed into a tree file, it is a tree or a list of problems."""
    try:
        parse_tree(GOOD[:at] + inserted + GOOD[at + removed :], "t.yaml", SKILLS)
    except FileProblems as error:
        assert error.problems


def test_every_node_type_is_built_from_its_registry_row() -> None:
    """The class that a row names exists, and an unknown kind is an error with the nearest one."""
    import importlib

    for row in node_types().values():
        module, _, name = row.factory.partition(":")
        assert callable(getattr(importlib.import_module(module), name))
    with pytest.raises(UnknownName, match="Did you mean 'timeout'"):
        node_type("timout")
