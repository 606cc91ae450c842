"""Why recorded runs ended as they did, and where two of them part."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings

from mpvi_bt.executive.drawing.cells import columns
from mpvi_bt.executive.trace.diff import Difference, diff, difference_text
from mpvi_bt.executive.trace.explain import Explanation, Link, explain
from mpvi_bt.executive.trace.explain_text import explanation_text
from mpvi_bt.executive.trace.read import Trace, read_trace
from mpvi_bt.executive.tree.yaml_io import from_expanded, parse_tree
from mpvi_bt.ground.errors import NodeError
from tests.test_trace import FETCH, At, Capture, episode, roots

TAKE = "fetch/get the cup/timeout"


def links(link: Link | None) -> Iterator[Link]:
    """A chain, from its head on."""
    if link is not None:
        yield link
        for below in link.below:
            yield from links(below)


def recorded(spec: Any, folder: Path, *watchers: Any, name: str = "t.jsonl", **settings: Any) -> Trace:
    """The trace of an episode, however it ends."""
    with contextlib.suppress(NodeError, KeyboardInterrupt):
        episode(spec, folder / name, *watchers, **settings)
    return read_trace(folder / name)


@pytest.fixture
def failed(tmp_path: Path) -> Explanation:
    """Of a fetch whose checker never says yes."""
    return explain(recorded(FETCH, tmp_path, answers=(False,)))


def test_the_chain_goes_from_the_root_to_the_leaf(failed: Explanation) -> None:
    """Each node on the way is there once, parents before children, with the reason where it arose."""
    assert failed.ending == "failure"
    found = [(link.path.removeprefix("fetch/"), link.reason) for link in links(failed.cause)]
    assert found == [
        ("fetch", ""),
        ("get the cup", "all_failed"),
        ("get the cup/retry", "out_of_tries"),
        ("get the cup/retry/try", ""),
        ("get the cup/retry/try/navigate", "unknown_target"),
        ("get the cup/timeout", "timeout"),
    ]


def test_a_timeout_tells_what_was_still_running(failed: Explanation) -> None:
    """Its deepest running nodes with their last words, and what the checker had answered meanwhile."""
    timeout = next(link for link in links(failed.cause) if link.path == TAKE)
    assert timeout.time_s - timeout.began_s == pytest.approx(3)
    running = {link.label: link.feedback for link in timeout.interrupted}
    assert running.keys() == {
        'Manipulate("pick up the cup with the right hand")',
        'CheckComplete("the cup is held")',
    }
    assert running['CheckComplete("the cup is held")'].startswith("asked 1: no")
    assert [(asked.answer.event, asked.answer.complete) for asked in timeout.asked] == [("grasp", False)]
    assert timeout.began_s <= timeout.asked[0].time_s <= timeout.time_s


def test_a_timeout_tells_the_failures_before_it(tmp_path: Path) -> None:
    """What was tried below it and failed, in order, though something else was running when the time was up."""
    spec = parse_tree(
        "tree: t\nroot:\n  timeout: 1\n  child:\n    retry: 9\n    child:\n      sequence: try\n      memory: true\n"
        "      children:\n        - wait: 0.4\n        - navigate: nowhere\n"
    )
    (cause,) = links(explain(recorded(spec, tmp_path)).cause)
    assert [(f.path, f.reason) for f in cause.earlier] == [("timeout/retry/try/navigate", "unknown_target")] * 2
    assert 0 < cause.earlier[0].time_s < cause.earlier[1].time_s < cause.time_s
    assert [link.path for link in cause.interrupted] == ["timeout/retry/try/wait"]


def test_what_failed_before_a_swap_is_told_as_what_it_was(tmp_path: Path) -> None:
    """Failures of nodes that the tree has no longer, or whose path is another's now, with their own labels."""
    spec = parse_tree(
        "tree: t\nroot:\n  timeout: 0.5\n  child:\n    retry: 100\n    child:\n      sequence: s\n      memory: true\n"
        "      children:\n        - fail: early\n"
    )
    new = parse_tree(
        "tree: t\nroot:\n  selector: s\n  memory: true\n  children:\n    - fail: late\n    - wait: 9\n"
    ).root
    for swapped, labels in (
        (parse_tree("tree: t\nroot:\n  wait: 9\n").root, ["fail: early"]),
        (new, ["fail: early", "fail: late"]),
    ):
        swap = At(5, lambda tree, new=swapped: tree.swap("timeout/retry/s", new))  # type: ignore[misc]
        (cause,) = links(explain(recorded(spec, tmp_path, swap)).cause)
        assert [link.label for link in cause.earlier] == labels
        assert {link.path for link in cause.earlier} == {"timeout/retry/s/fail"}
        assert [link.label for link in cause.interrupted] == ["wait 9 s"]
        assert cause.interrupted[0].began_s == pytest.approx(5 / 30)


def test_a_node_that_was_swapped_in_runs_since_then(tmp_path: Path) -> None:
    """Though one that was set just so ran there before."""
    spec = parse_tree("tree: t\nroot:\n  wait: 9\n")
    explanation = explain(recorded(spec, tmp_path, At(30, lambda tree: tree.swap("wait", spec.root)), max_time_s=2))
    assert [link.began_s for link in explanation.running] == [pytest.approx(1.0)]


@given(root=roots)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=80)
def test_the_chain_has_the_leaf_that_failed_the_root(tmp_path: Path, root: dict[str, Any]) -> None:
    """Of any tree that fails, the node that the run blames is in the chain with its reason, and no link lacks one."""
    spec = from_expanded({"tree": "t", "blackboard": {"k": 0}, "root": root})
    trace = recorded(spec, tmp_path, max_time_s=1)
    explanation = explain(trace)
    assert trace.end is not None
    failure = trace.end.failure
    assert (explanation.cause is not None) == (failure is not None)
    if failure is not None:
        chain = list(links(explanation.cause))
        assert chain[0].path == spec.nodes[0].path
        assert (failure.path, failure.reason) in [(link.path, link.reason) for link in chain]
        assert all(link.reason for link in chain if not link.below)
        assert all(link.began_s <= link.time_s for link in chain)
    assert all(columns(line) <= 80 for line in explanation_text(explanation).splitlines())


def test_a_success_lists_what_was_given_up(tmp_path: Path) -> None:
    """Every unit that was given up, with its own chain."""
    explanation = explain(recorded(FETCH, tmp_path, answers=(True,)))
    assert (explanation.ending, explanation.cause, explanation.running) == ("success", None, ())
    assert [link.path for link in explanation.gave_up] == ["fetch/greet"]
    assert [(link.path, link.reason) for link in links(explanation.gave_up[0])][1:] == [
        ("fetch/greet/navigate", "unknown_target")
    ]
    unit = {"sequence": None, "memory": True, "children": [{"wait": 0.5}, {"fail": "no"}]}
    again = from_expanded({"tree": "t", "root": {"repeat": 3, "child": {"attempt": None, "child": unit}}})
    gave_up = explain(recorded(again, tmp_path)).gave_up
    assert [link.time_s - link.began_s for link in gave_up] == pytest.approx([0.5] * 3)


def test_many_units_given_up_are_told_briefly(tmp_path: Path) -> None:
    """Of more than a few only the reasons are shown, of very many only the last."""
    unit = {"sequence": None, "memory": True, "children": [{"wait": 0.1}, {"fail": "no"}]}
    spec = from_expanded({"tree": "t", "root": {"repeat": 20, "child": {"attempt": None, "child": unit}}})
    explanation = explain(recorded(spec, tmp_path))
    assert len(explanation.gave_up) == 20
    lines = explanation_text(explanation).splitlines()
    assert lines[2:4] == ["20 units were given up on the way:", "  8 before, then"]
    assert sum(line.startswith("  -^- attempt") for line in lines) == 12
    assert lines[-1] == "      fail: no: no"


def test_a_cut_trace_tells_what_was_running(tmp_path: Path) -> None:
    """So does one of a run that its time limit or Ctrl-C ended."""
    raw = [(recorded(FETCH, tmp_path, answers=(False,)), tmp_path / "t.jsonl")]
    lines = raw[0][1].read_bytes().splitlines(keepends=True)
    (tmp_path / "cut.jsonl").write_bytes(b"".join(lines[:-2]) + lines[-2][:30])
    cut = explain(read_trace(tmp_path / "cut.jsonl"))
    assert cut.ending == "cut"
    assert [link.path.removeprefix(f"{TAKE}/take/") for link in cut.running] == ["manipulate", "check_complete"]
    assert cut.running[1].asked[0].answer.complete is False
    late = explain(recorded(FETCH, tmp_path, answers=(False,), max_time_s=4))
    assert (late.ending, [link.path for link in late.running]) == ("time_limit", [link.path for link in cut.running])


def test_an_error_is_told_with_its_node(tmp_path: Path) -> None:
    """Path and message of what broke."""

    def break_it(tree: Any) -> None:
        vars(tree.nodes[f"{TAKE}/take/manipulate"])["update"] = lambda: 1 / 0

    explanation = explain(recorded(FETCH, tmp_path, At(5, break_it)))
    assert explanation.ending == "error"
    assert explanation.error is not None
    assert (explanation.error.path, explanation.error.message) == (
        f"{TAKE}/take/manipulate",
        "ZeroDivisionError: division by zero",
    )
    text = explanation_text(explanation)
    assert "ZeroDivisionError: division by zero" in text
    assert f"in {TAKE}/take/manipulate" in text


def test_an_explanation_reads_well(failed: Explanation) -> None:
    """The text for people, whole, but for wall times."""
    assert re.sub(r"0\.\d{3} s", "0.0 s", explanation_text(failed)) == GOLDEN.strip()


GOLDEN = """
fetch: plan failed after 5.0 s, 1 unit given up, tick 152

{-} fetch                                                         0.0 s to 5.0 s
  {o} get the cup                                                 0.0 s to 5.0 s
      all_failed: retry: out_of_tries, timeout: timeout
    -^- retry, 2 tries                                            0.0 s to 2.0 s
        out_of_tries: 2 failed, the last with unknown_target: nothing known as
        'the moon'
      {-} try                                                     1.0 s to 2.0 s
        --> Navigate(the moon)                                          at 2.0 s
            unknown_target: nothing known as 'the moon'
            node: fetch/get the cup/retry/try/navigate
    -^- timeout 3 s                                               2.0 s to 5.0 s
        timeout: not done within 3 s: still at take/manipulate, check_complete
        (asked 1: no, as scripted)
        node: fetch/get the cup/timeout
        still running:
          --> Manipulate("pick up the cup with the right hand"), since 2.0 s
          --> CheckComplete("the cup is held"), since 2.0 s
              asked 1: no, as scripted
        asked at 2.2 s (after a grasp, right camera): "the cup is held"? no, as
        scripted

1 unit was given up on the way:
  -^- attempt: greet                                                    at 0.0 s
    --> Navigate(nowhere)                                               at 0.0 s
        unknown_target: nothing known as 'nowhere'
        node: fetch/greet/navigate

1 handoff to the policy, 0 confirmed by a checker:
  "pick up the cup with the right hand"                           2.0 s to 5.0 s
    timeout: the policy held still for 2.9 of 3.0 s, and the checker said no
      moved: neither base nor arms
      hands: right closed on something 1 time
      stood still: 2.9 of 3.0 s, 2.9 s of it at the end; commands asked for no
      motion in 3.0 s
      answers: 7, each of 15 actions, in 0.0 s each (wall time), at most
      0.0 s
      checker: asked 1 time, 1 no; the last no: "the cup is held": as scripted
"""


RECOVERING = """
tree: recovering
root:
  sequence: all of it
  memory: true
  children:
    - retry: 3
      child:
        sequence: take it
        memory: true
        children:
          - selector: get there
            memory: true
            children:
              - navigate: nowhere
              - wait: 0.5
          - test: late
    - wait: 0.1
    - selector: already there
      memory: true
      children:
        - test: late
        - succeed: so it is
blackboard:
  late: false
"""


@pytest.fixture(scope="module")
def recovered(tmp_path_factory: pytest.TempPathFactory) -> Explanation:
    """Of a run that succeeds at the second try, each of which takes the second way."""
    late = At(40, lambda tree: tree.context.blackboard.update(late=True))
    return explain(recorded(parse_tree(RECOVERING), tmp_path_factory.mktemp("recovering"), late))


def test_a_run_tells_what_it_recovered_from(recovered: Explanation) -> None:
    """What a retry or a selector succeeded in spite of, each failure where it began; within a larger one only once."""
    assert recovered.ending == "success"
    (recovery,) = recovered.recovered
    assert (recovery.node.path, recovery.tries, recovery.by) == ("all of it/retry", 3, "take it")
    assert [(f.label, f.reason) for f in recovery.failed] == [
        ("Navigate(nowhere)", "unknown_target"), ("test late is set", "test_false"),
    ] * 2 + [("Navigate(nowhere)", "unknown_target")]  # fmt: skip


def test_a_recovery_reads_well(recovered: Explanation) -> None:
    """The text for people: the node, what failed when, and what came of it."""
    assert explanation_text(recovered).splitlines()[2:] == RECOVERY.strip().splitlines()


RECOVERY = """
Recovered on the way:
  -^- retry, 3 tries                                              0.0 s to 1.6 s
      0.0 s: Navigate(nowhere): unknown_target: nothing known as 'nowhere'
      0.5 s: test late is set: test_false: late has no value
      0.5 s: Navigate(nowhere): unknown_target: nothing known as 'nowhere'
      1.0 s: test late is set: test_false: late has no value
      1.1 s: Navigate(nowhere): unknown_target: nothing known as 'nowhere'
      1.6 s: try 3 succeeded
"""


def test_a_selector_alone_tells_what_it_passed_over(tmp_path: Path) -> None:
    """The child that failed, and the one that succeeded in its place."""
    spec = parse_tree(
        "tree: t\nroot:\n  selector: s\n  memory: true\n  children: [{navigate: nowhere}, {succeed: anyhow}]\n"
    )
    (recovery,) = explain(recorded(spec, tmp_path)).recovered
    assert ([f.label for f in recovery.failed], recovery.by, recovery.tries) == (["Navigate(nowhere)"], "anyhow", 0)


def test_equal_runs_do_not_differ(tmp_path: Path) -> None:
    """Two runs of one seed; seeds and settings that differ are told, but do not make runs differ."""
    a = recorded(FETCH, tmp_path, name="a", answers=(True,), seed=1, policy={"name": "grip", "speed": 1})
    b = recorded(FETCH, tmp_path, name="b", answers=(True,), seed=1, policy={"name": "grip", "speed": 1})
    assert diff(a, b) == Difference()
    c = recorded(FETCH, tmp_path, name="c", answers=(True,), seed=2, policy={"name": "grip", "speed": 2})
    different = diff(a, c)
    assert different.same
    assert [(s.name, s.a, s.b) for s in different.settings] == [
        ("seed", 1, 2),
        ("config.seed", 1, 2),
        ("config.policy.speed", 1, 2),
    ]


def test_runs_part_at_the_first_tick_that_differs(tmp_path: Path) -> None:
    """The tick is the first after which the trees' own states differ; only what differs is listed, deepest first."""
    captures = Capture(), Capture()
    a = recorded(FETCH, tmp_path, captures[0], name="a", answers=(False,))
    b = recorded(FETCH, tmp_path, captures[1], name="b", answers=(True,))
    found = diff(a, b)
    states = list(zip(captures[0].states, captures[1].states, strict=False))
    first = next(i for i, (one, other) in enumerate(states) if one != other)
    assert found.tick == first + 1
    assert found.time_s == pytest.approx(first / 30)
    assert {node.path for node in found.nodes} == {
        path for path in states[first][0] if states[first][0][path] != states[first][1][path]
    }
    assert found.nodes[0].path.startswith(f"{TAKE}/take/")
    assert len(found.before) == 3
    for shared in found.before:
        assert captures[0].states[shared.tick - 1][shared.path].status == shared.state.status
        assert shared.tick < found.tick
    mirrored = diff(b, a)
    assert mirrored.tick == found.tick
    assert [(n.b, n.a) for n in mirrored.nodes] == [(n.a, n.b) for n in found.nodes]


def test_runs_part_by_the_blackboard_alone(tmp_path: Path) -> None:
    """A key that has another value in each run is where they part."""
    a = recorded(FETCH, tmp_path, name="a", answers=(True,))
    b = recorded(
        FETCH, tmp_path, At(7, lambda tree: tree.context.blackboard.update(extra=1)), name="b", answers=(True,)
    )
    found = diff(a, b)
    assert [(v.name, v.a, v.b) for v in found.blackboard] == [("extra", None, 1)]
    assert (found.tick, found.nodes) == (8, ())


def test_runs_part_by_their_ends_alone(tmp_path: Path) -> None:
    """One that was cut, or ended by its time limit, parts from one that went on the same way."""
    a = recorded(FETCH, tmp_path, name="a", answers=(True,))
    b = recorded(FETCH, tmp_path, name="b", answers=(True,), max_time_s=2.5)
    found = diff(a, b)
    assert (found.tick, found.same) == (None, False)
    assert found.end is not None
    assert (found.end.a["ending"], found.end.b["ending"]) == ("success", "time_limit")
    (tmp_path / "c").write_bytes(b"".join((tmp_path / "a").read_bytes().splitlines(keepends=True)[:-2]))
    cut = diff(a, read_trace(tmp_path / "c"))
    assert cut.end is not None
    assert cut.end.b["ending"] == "cut"
    assert not cut.same


def test_trees_that_differ_are_told_first(tmp_path: Path) -> None:
    """Nodes that only one tree has, or that are set otherwise."""
    other = from_expanded(
        {"tree": "t", "root": {"sequence": None, "memory": True, "children": [{"wait": 1}, {"wait": 2}]}}
    )
    one = from_expanded({"tree": "t", "root": {"sequence": None, "memory": True, "children": [{"wait": 3}]}})
    found = diff(recorded(one, tmp_path, name="a"), recorded(other, tmp_path, name="b"))
    assert [(v.name, v.a, v.b) for v in found.trees] == [
        ("sequence/wait", "--> wait 3 s", "--> wait 1 s"),
        ("sequence/wait#2", None, "--> wait 2 s"),
    ]
    assert not found.same
    swapped = At(3, lambda tree: tree.swap("sequence/wait", other.nodes[1].spec))
    late = diff(recorded(one, tmp_path, name="a"), recorded(one, tmp_path, swapped, name="c"))
    assert late.tick == 4
    assert [v.name for v in late.trees] == ["sequence/wait"]


def test_a_difference_reads_well(tmp_path: Path) -> None:
    """The text names the time, both states of each node and the settings, in 80 columns."""
    a = recorded(FETCH, tmp_path, name="a", answers=(False,), seed=1)
    b = recorded(FETCH, tmp_path, name="b", answers=(True,), seed=2)
    text = difference_text(diff(a, b), ("a.jsonl", "b.jsonl"))
    assert all(columns(line) <= 80 for line in text.splitlines())
    assert re.search(r"^they part at 2\.\d s, tick \d+:$", text, re.MULTILINE)
    assert re.search(r"check_complete\n    A  running  asked 1: no.*\n    B  success  asked 1: yes", text)
    assert "  seed\n    A  1\n    B  2\n" in text
    assert difference_text(diff(a, a)).endswith("they went the same way")


@pytest.mark.parametrize("width", range(40, 60))
def test_no_line_ends_between_a_number_and_its_unit(width: int) -> None:
    """However wide it is."""
    link = Link("wait", "-->", "a label of several words", "RUNNING", 2.0, 2.0)
    explanation = Explanation("t", "interrupted", "interrupted after 12.5 s", 1, 12.5, running=(link,))
    text = explanation_text(explanation, width)
    assert " ".join(text.split()).endswith("since 2.0 s")
    assert not re.search(r"\d$", text.partition("Running then:")[2], re.MULTILINE)


def test_trees_that_differ_may_go_the_same_way(tmp_path: Path) -> None:
    """Both are said."""
    for name, duration in (("a", "1.0"), ("b", "30 steps")):
        episode(parse_tree(f"tree: t\nroot: {{wait: {duration}}}\n"), tmp_path / name)
    found = diff(read_trace(tmp_path / "a"), read_trace(tmp_path / "b"))
    assert found.trees
    assert difference_text(found).endswith("\n\napart from that they went the same way")
