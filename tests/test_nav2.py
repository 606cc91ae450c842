"""Trees of ROS's Nav2 in our nodes: small ones of our own, with the kinds of nodes that Nav2's own have."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.executive.btcpp.importing import from_xml
from mpvi_bt.executive.btcpp.mapping import NAV2
from mpvi_bt.executive.ticking.dry import dry_tree, run_dry
from mpvi_bt.executive.tree.lint import lint
from mpvi_bt.executive.tree.yaml_io import parse_tree
from mpvi_bt.ground.errors import FileProblems
from tests.test_btcpp import main_tree

PLAN = "<RateController hz='2.0'><ComputePathToPose goal='{goal}' path='{path}'/></RateController>"
DRIVE = f"""
<PipelineSequence>
  <PlannerSelector selected_planner='{{planner}}'/>
  {PLAN}
  <RecoveryNode number_of_retries='1'><FollowPath path='{{path}}'/><ClearEntireCostmap/></RecoveryNode>
</PipelineSequence>
"""
WHOLE = f"""
<RecoveryNode number_of_retries='4' name='drive'>
  {DRIVE}
  <ReactiveFallback>
    <GoalUpdated/>
    <RoundRobin name='recover'>
      <Sequence><ClearEntireCostmap/><ClearEntireCostmap/></Sequence>
      <Spin spin_dist='3.14'/>
      <Wait wait_duration='5.0'/>
      <BackUp backup_dist='0.3'/>
    </RoundRobin>
  </ReactiveFallback>
</RecoveryNode>
"""
OURS = """
tree: t
parameters: {goal: text}
blackboard: {round_robin: 0}
root:
  retry: 5
  child:
    selector: drive
    memory: true
    children:
      - retry: 2
        child: {navigate: $goal}
      - sequence: recovery
        memory: true
        children:
          - selector: recover
            memory: true
            children:
              - sequence: turn 1
                memory: true
                children:
                  - {test: round_robin, equals: 0}
                  - {set: round_robin, value: 1}
                  - look_around: 180
              - sequence: turn 2
                memory: true
                children:
                  - {test: round_robin, equals: 1}
                  - {set: round_robin, value: 0}
                  - wait: 5
          - fail: try_again
"""


def test_recovery_becomes_retries_and_planning_is_left_to_navigate() -> None:
    """What plans is told in one line, an action without an equal where it stands."""
    imported = from_xml(main_tree(WHOLE), "t.xml")
    assert imported.main == parse_tree(OURS)
    assert lint(imported.main) == []
    told = [p.message for p in imported.warnings if p.code == "btcpp-nav2"]
    assert "PlannerSelector (line 7), ComputePathToPose (line 8)" in told[0]
    assert told[1].startswith("BackUp has no equal here and is left out")


@pytest.mark.parametrize(
    ("xml", "root"),
    [
        (DRIVE, "{retry: 2, child: {navigate: $goal}}"),
        ("<NavigateToPose goal='{place}'/>", "{navigate: $place}"),
        (
            "<Sequence><GoalUpdater input_goal='{a}' output_goal='{b}'><ComputePathToPose goal='{b}' path='{p}'/>"
            "</GoalUpdater><SmoothPath unsmoothed_path='{p}' smoothed_path='{s}'/><FollowPath path='{s}'/></Sequence>",
            "{navigate: $a}",
        ),
        (
            "<Sequence><GoalUpdated/><NavigateToPose goal='{goal}'/></Sequence>",
            "{sequence: ~, memory: true, children: [fail: goal_not_updated, navigate: $goal]}",
        ),
        (
            "<Fallback><ComputePathToPose goal='{g}' path='{p}' _onSuccess='n := 1'/>"
            "<FollowPath path='{p}'/></Fallback>",
            "{selector: ~, memory: true, children: [{sequence: ~, memory: true, children: "
            "[succeed: ~, {set: n, value: 1}]}, navigate: $g]}",
        ),
    ],
)
def test_a_path_that_is_followed_is_a_drive_to_where_it_leads(xml: str, root: str) -> None:
    """Whatever planned, smoothed or renamed it; its goal is a parameter, and no condition is dropped."""
    main = from_xml(main_tree(xml)).main
    head = "".join(f"  {name}: text\n" for name in main.parameters)
    assert main == parse_tree(f"tree: t\nparameters:\n{head}root: {root}")


@pytest.mark.parametrize(
    ("xml", "n", "m"),
    [
        (
            "<Repeat num_cycles='3'><RoundRobin><Script code='n += 1'/><Script code='m += 1'/></RoundRobin></Repeat>",
            2,
            1,
        ),
        (
            "<RecoveryNode number_of_retries='5'><Sequence><Script code='n += 1'/><ScriptCondition code='n >= 3'/>"
            "</Sequence><Script code='m += 1'/></RecoveryNode>",
            3,
            2,
        ),
    ],
)
def test_what_is_rewritten_does_the_same(xml: str, n: int, m: int) -> None:
    """Children take turns; a recovery follows each failure, until the child succeeds."""
    first = "<Sequence name='first values of the blackboard'><Script code='n := 0'/><Script code='m := 0'/>"
    after = f"<ScriptCondition code='n == {n}'/><ScriptCondition code='m == {m}'/>"
    tree = from_xml(main_tree(f"{first}<Sequence>{xml}{after}</Sequence></Sequence>")).main
    assert run_dry(dry_tree(tree)).ending == "success"


@pytest.mark.parametrize(
    ("xml", "column", "words"),
    [
        ("<Sequence><BackUp/><Wait wait_duration='1'/></Sequence>", 11, "the nearest is navigate"),
        ("<Fallback><BackUp/><DriveOnHeading/></Fallback>", 11, "BackUp of Nav2 has no equal here"),
        ("<RateController hz='1'><Say text='a'/></RateController>", 1, "the nearest is cooldown"),
        ("<FollowPath path='{path}'/>", 13, "nothing in this tree plans the path"),
        (PLAN, 1, "this tree only plans"),
        ("<KeepRunningUntilFailure><Say text='a'/></KeepRunningUntilFailure>", 1, "the nearest is Repeat"),
        ("<RoundRobin><Say text='a' _skipIf='a == 1'/><Say text='b'/></RoundRobin>", 27, "below a node of Nav2"),
        ("<RecoveryNode number_of_retries='many'><Say text='a'/><Say text='b'/></RecoveryNode>", 1, "whole number"),
        ("<IsBatteryLow min_battery='0.2'/>", 1, "IsBatteryLow of Nav2 has no equal here"),
    ],
)
def test_what_has_no_equal_is_refused_with_the_nearest(xml: str, column: int, words: str) -> None:
    """At its place."""
    with pytest.raises(FileProblems) as caught:
        from_xml(main_tree(xml), "t.xml")
    assert any(words in p.message and (p.line, p.column) == (3, column) for p in caught.value.problems)


def test_a_goal_is_handed_to_the_tree_that_drives() -> None:
    """As an argument of its call, whose name is the key's."""
    xml = f"""<root BTCPP_format='4' main_tree_to_execute='main'>
      <BehaviorTree ID='main'><Sequence><SubTree ID='go' goal='{{goal}}' _autoremap='true'/></Sequence></BehaviorTree>
      <BehaviorTree ID='go'>{DRIVE}</BehaviorTree></root>"""
    imported = from_xml(xml)
    assert list(imported.main.parameters) == list(imported.subtrees["go"].parameters) == ["goal"]
    assert imported.main.root.children[0].parameters.model_dump()["arguments"] == {"goal": "$goal"}
    assert lint(imported.main) == []


_tags = sorted(NAV2) + ["Fallback", "Sequence", "Inverter", "Delay", "Switch2", "SubTree", "Say", "ForceFailure"]
_keys = [
    "path",
    "goal",
    "input_path",
    "output_path",
    "input_goal",
    "output_goal",
    "variable",
    "case_1",
    "ID",
    "_skipIf",
]
_leaves = st.tuples(
    st.sampled_from(_tags), st.dictionaries(st.sampled_from(_keys), st.sampled_from(["{a}", "{b}", "t"]))
)
_nodes = st.recursive(
    _leaves.map(lambda leaf: (*leaf, "")),
    lambda inner: st.tuples(_leaves, st.lists(inner, max_size=3)).map(lambda n: (*n[0], "".join(map(_written, n[1])))),
)


def _written(node: tuple[str, dict[str, str], str]) -> str:
    tag, attributes, inner = node
    return f"<{tag} {' '.join(f'{k}={v!r}' for k, v in attributes.items())}>{inner}</{tag}>"


@given(_nodes)
def test_no_tree_is_a_traceback(node: tuple[str, dict[str, str], str]) -> None:
    """Whatever nodes stand below one another, they are read or their problems are told."""
    with contextlib.suppress(FileProblems):
        from_xml(main_tree(_written(node)))


def test_a_deep_tree_is_read_in_time() -> None:
    """Each node is looked at once."""
    deep = "<Inverter>" * 60 + WHOLE + "</Inverter>" * 60
    assert from_xml(main_tree(deep)).main.root.kind == "invert"
