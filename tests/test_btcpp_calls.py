"""What calls hand on to subtrees: ports with texts, other keys, and the defaults under <TreeNodesModel>."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from py_trees.behaviour import Behaviour
from py_trees.common import Status

from mpvi_bt.executive.behaviors.node import Leaf
from mpvi_bt.executive.behaviors.parameters import NavigateTo
from mpvi_bt.executive.btcpp.importing import ImportedTrees, from_xml
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.spec import Placed, TreeSpec
from mpvi_bt.executive.tree.yaml_io import dump_tree, load_tree
from mpvi_bt.ground.errors import FileProblems
from mpvi_bt.testing import KinematicWorld, scripted_context
from tests.test_btcpp_real import CHECKER

VISIT = '<Navigate target="{goal}"/>'
SOFA = "<Script code=\"goal := 'sofa:S'; place := 'hall:S'\"/>"
MODEL = '<SubTree ID="Visit"><input_port name="goal" default="trash can:S"/></SubTree>'


def file(calls: str, models: str = "", visit: str = VISIT, more: str = "") -> str:
    """A file whose main tree sets the keys "goal" and "place", makes calls, and ends."""
    return (
        f'<root BTCPP_format="4" main_tree_to_execute="Round">\n<BehaviorTree ID="Round"><Sequence>{SOFA}\n'
        f'{calls}\n</Sequence></BehaviorTree>\n<BehaviorTree ID="Visit">{visit}</BehaviorTree>{more}'
        '<TreeNodesModel>\n<Action ID="Navigate">\n<input_port name="target" type="std::string"/>\n</Action>\n'
        f"{models}</TreeNodesModel></root>"
    )


TWICE = (
    '<BehaviorTree ID="Twice"><Sequence><SubTree ID="Visit" goal="{to}"/><SubTree ID="Visit" _autoremap="true"/>'
    "</Sequence></BehaviorTree>"
)
WHERE = {
    "the default, not the caller's key": ('<SubTree ID="Visit"/>', MODEL, "", ["trash can"]),
    "a text before the default": ('<SubTree ID="Visit" goal="cup:S"/>', MODEL, "", ["cup"]),
    "a key of the same name": ('<SubTree ID="Visit" goal="{goal}"/>', MODEL, "", ["sofa"]),
    "a key of the same name in short": ('<SubTree ID="Visit" goal="{=}"/>', MODEL, "", ["sofa"]),
    "a key of another name": ('<SubTree ID="Visit" goal="{place}"/>', "", "", ["hall"]),
    "a default that is a key": ('<SubTree ID="Visit"/>', MODEL.replace("trash can:S", "{place}"), "", ["hall"]),
    "with _autoremap no default": ('<SubTree ID="Visit" _autoremap="true"/>', MODEL, "", ["sofa"]),
    "a text beside _autoremap": ('<SubTree ID="Visit" _autoremap="1" goal="cup:S"/>', "", "", ["cup"]),
    "calls that differ": (
        '<SubTree ID="Visit" goal="cup:S"/><SubTree ID="Visit" goal="{place}"/><SubTree ID="Visit"/>',
        MODEL,
        "",
        ["cup", "hall", "trash can"],
    ),
    "calls within calls": (
        '<SubTree ID="Twice" to="cup:S" goal="{place}"/>',
        "",
        TWICE,
        ["cup", "hall"],
    ),
}  # (calls, models, more trees, where they drive)


class Driving(Leaf):
    """A drive that ends at once, and says where to."""

    def __init__(self, target: str, log: list[str]) -> None:
        super().__init__("navigate")
        self.target, self.log = target, log

    def update(self) -> Status:
        self.log.append(self.resolve(self.target).partition(":")[0])
        return Status.SUCCESS


def drives(tree: TreeSpec) -> list[str]:
    """Where a tree drives to until it ends."""
    log: list[str] = []

    def driving(placed: Placed, make: Callable[[], Behaviour]) -> Behaviour:
        given = placed.spec.parameters
        return Driving(given.target, log) if isinstance(given, NavigateTo) else make()

    made = Tree(tree, driving)
    made.setup(scripted_context(KinematicWorld(), {}, {}, {}))
    for _ in range(20):
        if made.tick() is not Status.RUNNING:
            return log
    raise AssertionError("it does not end")


def written(imported: ImportedTrees, folder: Path) -> TreeSpec:
    """The main tree as it is read from the files that are written."""
    for spec in (imported.main, *imported.subtrees.values()):
        (folder / f"{spec.name}.yaml").write_text(dump_tree(spec))
    return load_tree(folder / f"{imported.main.name}.yaml")


@pytest.mark.parametrize("case", WHERE)
def test_a_subtree_drives_where_its_call_says(case: str, tmp_path: Path) -> None:
    """Texts, keys of other names and defaults reach it, in memory and from the files that are written."""
    calls, models, more, expected = WHERE[case]
    imported = from_xml(file(calls, models, more=more))
    assert drives(imported.main) == expected
    assert drives(written(imported, tmp_path)) == expected
    assert written(imported, tmp_path) == imported.main


@pytest.mark.skipif(not CHECKER, reason="BTCPP_CHECKER names no program built from tests/btcpp")
@pytest.mark.parametrize("case", WHERE)
def test_btcpp_drives_there_too(case: str, tmp_path: Path) -> None:
    """The real one, from the same file."""
    calls, models, more, expected = WHERE[case]
    (tmp_path / "t.xml").write_text(file(calls, models, more=more))
    done = subprocess.run(
        [CHECKER, str(tmp_path / "t.xml"), "--ticks", "1"], capture_output=True, text=True, check=True
    )
    assert [line.strip()[:-2] for line in done.stdout.splitlines() if line.startswith("  ")] == expected


MANDATORY = MODEL.replace(' default="trash can:S"', "")
REFUSED = {
    "a mandatory port": ('<SubTree ID="Visit"/>', MANDATORY, VISIT, (3, 1), "missing-port", "needs the port 'goal'"),
    "an empty default is none": (
        '<SubTree ID="Visit"/>',
        MODEL.replace("trash can:S", ""),
        VISIT,
        (3, 1),
        "missing-port",
        "line 9 declares without a default",
    ),
    "an empty text": ('<SubTree ID="Visit" goal=""/>', "", VISIT, (3, 21), "port-value", "a line of text"),
    "a key that we can't name": ('<SubTree ID="Visit" goal="{Goal}"/>', "", VISIT, (3, 21), "port-value", "'cup_2'"),
    "a key that is tested": (
        '<SubTree ID="Visit" goal="cup"/>',
        "",
        "<ScriptCondition code=\"goal == 'cup'\"/>",
        (5, 43),
        "subtree-port",
        "can't be set or tested",
    ),
    "a key that is set": (
        '<SubTree ID="Visit" goal="{place}"/>',
        "",
        "<Sequence><SetBlackboard output_key=\"goal\" value=\"x\"/></Sequence>",
        (5, 51),
        "subtree-port",
        "can't be set or tested",
    ),
    "milliseconds": ('<SubTree ID="Visit" ms="5"/>', "", '<Sleep msec="{ms}"/>', (5, 33), "port-value", "milliseconds"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_handed_on_is_refused_at_its_place(case: str) -> None:
    """A port without a value, a text that is none, and a key that a parameter cannot stand for."""
    calls, models, visit, place, code, words = REFUSED[case]
    with pytest.raises(FileProblems) as caught:
        from_xml(file(calls, models, visit), "t.xml")
    assert [(p.line, p.column, p.code) for p in caught.value.problems] == [(*place, code)]
    assert words in caught.value.problems[0].message


def test_a_port_that_nothing_reads_is_told() -> None:
    """At its place; it has no effect here."""
    imported = from_xml(file('<SubTree ID="Visit" goal="cup" speed="fast"/>'), "t.xml")
    told = [(p.line, p.column) for p in imported.warnings if p.code == "btcpp-subtree-port"]
    assert told == [(3, 32)]


def test_numbers_stay_numbers(tmp_path: Path) -> None:
    """Where each call gives one and no text is made of it, the parameter is a number; else it is a text."""
    visit = '<RetryUntilSuccessful num_attempts="{tries}"><Navigate target="{goal}"/></RetryUntilSuccessful>'
    imported = from_xml(file('<SubTree ID="Visit" tries="3" goal="7"/>', visit=visit))
    assert {name: p.type for name, p in imported.subtrees["Visit"].parameters.items()} == {
        "goal": "text",
        "tries": "integer",
    }
    assert written(imported, tmp_path) == imported.main


def test_keys_of_its_own_are_told_where_a_subtree_has_any() -> None:
    """Without _autoremap; a subtree whose keys are all handed on has none."""
    told = [p.message for p in from_xml(file('<SubTree ID="Visit"/>')).warnings if p.code == "btcpp-subtree"]
    assert told == ["without _autoremap tree 'Visit' has keys of its own there, here they are of the run: 'goal'"]
    assert not [p for p in from_xml(file('<SubTree ID="Visit" goal="{=}"/>')).warnings if p.code == "btcpp-subtree"]


def test_the_default_of_a_nodes_port_is_filled_in() -> None:
    """As the node's class fills it in there; a port that our node lacks is refused where it is declared."""
    models = '<Action ID="LookAround"><input_port name="degrees" default="90"/></Action>'
    assert from_xml(file("<LookAround/>", models)).main.root.children[-1].label == "look around, 90 degrees"
    speed = '<Action ID="Say"><input_port name="speed" default="0.5"/></Action>'
    with pytest.raises(FileProblems) as caught:
        from_xml(file('<Say text="a"/>', speed), "t.xml")
    assert [(p.line, p.column, p.code) for p in caught.value.problems] == [(9, 43, "unknown-port")]


_texts = st.sampled_from(["cup", "{goal}", "{place}", "{=}", "{other}", "7", "", "{Goal}"])
_calls = st.builds(
    lambda tree, ports, autoremap: f"<SubTree ID='{tree}' {ports} {autoremap}/>",
    st.sampled_from(["Visit", "Twice"]),
    st.dictionaries(st.sampled_from(["goal", "to", "place"]), _texts).map(
        lambda ports: " ".join(f"{k}='{v}'" for k, v in ports.items())
    ),
    st.sampled_from(["", "_autoremap='true'", "_autoremap='false'"]),
)


@given(st.lists(_calls, min_size=1, max_size=3), st.sampled_from(["", MODEL, MANDATORY]), st.booleans())
def test_what_is_read_is_what_its_files_say(
    tmp_path_factory: pytest.TempPathFactory, calls: list[str], models: str, needed: bool
) -> None:
    """Whatever calls hand on, the tree in memory is that of the files, or the problems are told."""
    visit = f"<Sequence>{VISIT}<FollowPath path='{{place}}'/></Sequence>" if needed else VISIT
    try:
        imported = from_xml(file("".join(calls), models, visit, TWICE))
    except FileProblems:
        return
    assert written(imported, tmp_path_factory.mktemp("trees")) == imported.main
