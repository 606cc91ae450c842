"""Traces: what is written while a tree is ticked, read back tick by tick."""

from __future__ import annotations

import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import MISSING, fields, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from mpvi_bt.executive.behaviors.registry import node_types
from mpvi_bt.executive.monitors.handoff import Handoff
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.ticking.dry import dry_tree, run_dry
from mpvi_bt.executive.ticking.loop import Outcome, Subscriber, Watcher, World, run_episode
from mpvi_bt.executive.trace.explain import explain
from mpvi_bt.executive.trace.explain_text import explanation_text
from mpvi_bt.executive.trace.lines import CheckerAnswer, End, Header, Replanned, Tick
from mpvi_bt.executive.trace.read import Trace, read_trace
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.reader import MAX_DEPTH
from mpvi_bt.executive.tree.saving import SavedTree, save
from mpvi_bt.executive.tree.spec import NodeSpec, TreeSpec
from mpvi_bt.executive.tree.state import NodeState
from mpvi_bt.executive.tree.substitute import load_rules
from mpvi_bt.executive.tree.yaml_io import from_expanded, parse_tree
from mpvi_bt.ground.errors import BackendError, FileProblems, NodeError, UnknownName, UserError
from mpvi_bt.runs.recording.recorder import Recorder
from mpvi_bt.testing import KinematicWorld, scripted_context

SKILLS = load_skills()
FETCH = parse_tree(
    """
tree: fetch
root:
  sequence: fetch
  memory: true
  children:
    - set: cups
      value: 0
    - attempt: greet
      child:
        navigate: nowhere
    - selector: get the cup
      memory: true
      children:
        - retry: 2
          child:
            sequence: try
            memory: true
            children:
              - wait: 1
              - navigate: the moon
        - timeout: 3
          child:
            until_complete: take
            children:
              - manipulate: pick up the cup with the right hand
              - check_complete: the cup is held
    - set: cups
      add: 1
    - navigate: cup
""",
    skills=SKILLS,
)


class Capture(Watcher):
    """Keeps how every node and the blackboard stood after each tick."""

    def __init__(self) -> None:
        self.states: list[dict[str, NodeState]] = []
        self.blackboards: list[dict[str, Any]] = []

    def step(self, tree: Tree, world: World) -> None:
        self.states.append(tree.states())
        self.blackboards.append(dict(tree.context.blackboard))


class At(Watcher):
    """Does something after a tick."""

    def __init__(self, tick: int, what: Callable[[Tree], object]) -> None:
        self.left, self.what = tick, what

    def step(self, tree: Tree, world: World) -> None:
        self.left -= 1
        if self.left == 0:
            self.what(tree)


def episode(
    spec: TreeSpec,
    file: Path,
    *watchers: Subscriber,
    answers: tuple[bool, ...] = (),
    max_time_s: float = 20,
    **config: Any,
) -> Outcome:
    """Run a tree against doubles and record it."""
    world = KinematicWorld()
    places = {"cup": (0.5, 0.2), "sofa": (0.0, -0.4)}
    context = scripted_context(world, SKILLS, places, {"the cup is held": answers})
    recorder = Recorder(file, config, seed=config.get("seed"))
    return run_episode(Tree(spec), world, context, [recorder, *watchers], max_time_s=max_time_s)


def untimed(states: dict[str, NodeState]) -> dict[str, NodeState]:
    """The states without the times of nodes that run, which go on between the ticks that are recorded."""
    return {
        path: replace(state, elapsed_s=None) if state.status == "RUNNING" else state for path, state in states.items()
    }


def check_against(trace: Trace, capture: Capture) -> None:
    """The trace tells of every tick what the tree itself said then."""
    for tick, (states, blackboard) in enumerate(zip(capture.states, capture.blackboards, strict=True), 1):
        told = trace.states_at(tick)
        assert untimed(told) == untimed(states), tick
        assert trace.blackboard(trace.index_at(tick)) == blackboard
        for path, state in told.items():
            assert state.elapsed_s == pytest.approx(states[path].elapsed_s, abs=1e-9), (tick, path)


leaves = st.sampled_from(
    [
        {"navigate": "cup"},
        {"navigate": "nowhere"},
        {"wait": 0.1},
        {"wait": "2 steps"},
        {"set": "k", "add": 1},
        {"set": "k", "value": "text"},
        {"test": "k", "equals": 1},
        {"test": "k", "at_least": 2},
        {"say": "$k"},
        {"succeed": None},
        {"fail": "broken"},
    ]
)


def above(inner: st.SearchStrategy[dict[str, Any]]) -> st.SearchStrategy[dict[str, Any]]:
    one = st.sampled_from(
        [
            {"attempt": None},
            {"timeout": 0.2},
            {"timeout": "3 steps"},
            {"retry": 2},
            {"repeat": 2},
            {"invert": None},
            {"condition": "k", "at_most": 2},
            {"cooldown": 0.1},
        ]
    )
    many = st.sampled_from(
        [
            {"sequence": None, "memory": True},
            {"sequence": None, "memory": False},
            {"selector": None, "memory": True},
            {"selector": None, "memory": False},
            {"parallel": None, "policy": "success_on_one"},
            {"parallel": None, "policy": "success_on_all"},
            {"until_complete": None},
        ]
    )
    return st.builds(lambda node, child: {**node, "child": child}, one, inner) | st.builds(
        lambda node, children: {**node, "children": children}, many, st.lists(inner, min_size=2, max_size=3)
    )


roots = st.recursive(leaves, above, max_leaves=8)


@example(
    root={
        "sequence": None,
        "memory": True,
        "children": [
            {"navigate": "cup"},
            {"parallel": None, "policy": "success_on_one", "children": [{"navigate": "cup"}, {"wait": 0.1}]},
        ],
    },
    again=1,
)  # `wait` begins and is interrupted within one tick
@example(
    root={
        "selector": None,
        "memory": False,
        "children": [{"timeout": 0.2, "child": {"navigate": "cup"}}, {"wait": 0.1}],
    },
    again=2,
)  # `timeout` ends twice in the same way, after different times
@given(root=roots, again=st.integers(1, 4))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
def test_a_trace_tells_of_every_tick_what_the_tree_said(tmp_path: Path, root: dict[str, Any], again: int) -> None:
    """Read back, every node and every key stands as it stood, at any tick of any tree."""
    spec = from_expanded({"tree": "t", "blackboard": {"k": 0}, "root": {"repeat": again, "child": root}})
    capture = Capture()
    outcome = episode(spec, tmp_path / "t.jsonl", capture, max_time_s=1)
    trace = read_trace(tmp_path / "t.jsonl")
    check_against(trace, capture)
    assert trace.tree == spec
    assert trace.end is not None
    assert (trace.end.ending, trace.end.tick, trace.end.time_s) == (outcome.ending, outcome.ticks, outcome.time_s)


def test_a_trace_holds_only_what_changed(tmp_path: Path) -> None:
    """No line repeats a node as it was; ticks at which nothing changed have no line."""
    outcome = episode(FETCH, tmp_path / "t.jsonl", answers=(False,))
    trace = read_trace(tmp_path / "t.jsonl")
    before: dict[str, NodeState] = {}
    for change in trace.ticks:
        assert change.nodes
        assert all(before.get(path) != state for path, state in change.nodes.items())
        before.update(change.nodes)
    assert len(trace.ticks) < 20 < outcome.ticks
    assert [change.tick for change in trace.ticks] == sorted({change.tick for change in trace.ticks})


def test_a_trace_says_what_was_run(tmp_path: Path) -> None:
    """Tree, configuration, seed and version are in the first line; the checker's answers at their ticks."""
    outcome = episode(FETCH, tmp_path / "t.jsonl", answers=(False,), seed=7, policy={"name": "grip"})
    trace = read_trace(tmp_path / "t.jsonl")
    assert (trace.tree, trace.seed, trace.config) == (FETCH, 7, {"seed": 7, "policy": {"name": "grip"}})
    told = [(change.time_s, q.criterion, q.complete, q.path) for change in trace.ticks for q in change.queries]
    assert told == [(q.time_s, q.criterion, q.complete, q.path) for q in outcome.log.queries]
    assert [complete for _, _, complete, _ in told] == [False]


@pytest.mark.parametrize("ending", ["success", "failure", "time_limit", "interrupted", "error"])
def test_the_last_line_says_how_it_ended(tmp_path: Path, ending: str) -> None:
    """Every way to end is told, with the tick, the simulated time, the root's failure and the error."""

    def end(tree: Tree) -> None:
        if ending == "interrupted":
            raise KeyboardInterrupt
        raise RuntimeError("a fuse blew")

    last = FETCH.nodes[-1].path
    spec = FETCH if ending != "failure" else parse_tree("tree: t\nroot:\n  fail: broken\n")
    watchers = [At(40, end)] if ending in ("interrupted", "error") else []
    limit = 2 if ending == "time_limit" else 20
    try:
        episode(spec, tmp_path / "t.jsonl", *watchers, answers=(True,), max_time_s=limit)
    except (KeyboardInterrupt, RuntimeError):
        assert watchers
    trace = read_trace(tmp_path / "t.jsonl")
    assert trace.end is not None
    assert not trace.cut
    assert trace.end.ending == ending
    assert (trace.end.failure is not None) == (ending == "failure")
    assert (trace.end.error is not None) == (ending == "error")
    if trace.end.failure:
        assert (trace.end.failure.reason, trace.end.failure.path) == ("broken", "fail")
    if trace.end.error:
        assert (trace.end.error.message, trace.end.error.path) == ("RuntimeError: a fuse blew", "")
    if ending == "time_limit":
        assert trace.end.time_s == pytest.approx(2.0)
        assert trace.states(-1)[FETCH.nodes[0].path].status == "RUNNING"
        assert trace.states(-1)[last].status == "INVALID"


def test_a_behavior_that_raises_is_named(tmp_path: Path) -> None:
    """The node's path and the error's words are in the trace, and how every node stood when it raised."""
    navigate = FETCH.nodes[-1].path

    def break_it(tree: Tree) -> None:
        def update() -> None:
            raise ZeroDivisionError("no map")

        vars(tree.nodes[navigate])["update"] = update

    with pytest.raises(NodeError):
        episode(FETCH, tmp_path / "t.jsonl", At(5, break_it), answers=(True,))
    trace = read_trace(tmp_path / "t.jsonl")
    assert trace.end is not None
    assert trace.end.error is not None
    assert (trace.end.error.path, trace.end.error.message) == (navigate, "ZeroDivisionError: no map")
    line = break_it.__code__.co_firstlineno + 2
    assert trace.end.error.place.endswith(f"tests/test_trace.py:{line}")  # of the behavior's own code
    assert f"at {trace.end.error.place}" in explanation_text(explain(trace), width=200)
    assert trace.states(-1)[navigate].status == "FAILURE"
    assert trace.states(-1)["fetch/get the cup/timeout"].status == "SUCCESS"
    assert trace.ticks[-1].tick == trace.end.tick


def test_a_setup_that_fails_is_recorded(tmp_path: Path) -> None:
    """A tree that cannot be set up leaves a trace that says why."""
    spec = parse_tree("tree: t\nroot:\n  check_complete: the cup is held\n  skill: juggle\n")
    with pytest.raises(UnknownName):
        episode(spec, tmp_path / "t.jsonl")
    trace = read_trace(tmp_path / "t.jsonl")
    assert trace.end is not None
    assert trace.end.error is not None
    assert "juggle" in trace.end.error.message
    assert (len(trace.ticks), trace.end.tick) == (0, 0)


def test_a_swapped_part_is_recorded(tmp_path: Path) -> None:
    """From the tick after a swap the trace has the new tree, and states of its nodes only."""
    new = parse_tree("tree: t\nroot:\n  sequence: better\n  memory: true\n  children:\n    - wait: 0.5\n").root
    capture = Capture()
    swap = At(20, lambda tree: tree.swap("fetch/get the cup", new))
    episode(FETCH, tmp_path / "t.jsonl", capture, swap)
    trace = read_trace(tmp_path / "t.jsonl")
    check_against(trace, capture)
    i = trace.index_at(21)
    assert trace.tree_at(i - 1) == FETCH
    assert "fetch/better/wait" in {node.path for node in trace.tree_at(i).nodes}
    assert trace.states(i).keys() == {node.path for node in trace.tree_at(i).nodes}
    assert trace.tree == FETCH


def whole(spec: str) -> NodeSpec:
    """A node by its YAML."""
    return parse_tree("tree: t\nroot:\n" + "".join(f"  {line}\n" for line in spec.splitlines())).root


PARTS = [
    "wait: 0.5",
    "wait: 9",
    "say: hello",
    "timeout: 0.2\nchild: {wait: 9}",
    "sequence: lap\nmemory: true\nchildren: [{wait: 0.1}, {wait: 0.3}]",
    "retry: 3\nchild: {fail: no}",
]


@given(swaps=st.lists(st.tuples(st.integers(1, 12), st.integers(0, 9), st.sampled_from(PARTS)), max_size=5))
@example(swaps=[(12, 1, "wait: 9"), (6, 1, "wait: 9")])  # one that runs, for one that begins to, and is as it was
@example(swaps=[(9, 1, "say: hello"), (3, 1, "wait: 9")])  # a path goes, and comes back
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
def test_a_trace_tells_of_every_tick_across_swaps(tmp_path: Path, swaps: list[tuple[int, int, str]]) -> None:
    """Read back, every node of the tree in force stands as it stood, with its time, whatever was put in its place."""

    class Swaps(Watcher):
        def step(self, tree: Tree, world: World) -> None:
            self.wait += 1
            if left and self.wait >= left[0][0] and tree.status.value == "RUNNING":
                _, at, part = left.pop(0)
                self.wait = 0
                tree.swap(list(tree.nodes)[at % len(tree.nodes)], whole(part))

        wait = 0

    left = swaps.copy()

    spec = from_expanded({"tree": "t", "root": {"timeout": 60, "child": {"wait": 9}}})
    capture, recorder, world = Capture(), Recorder(tmp_path / "t.jsonl"), KinematicWorld()
    context = scripted_context(world, SKILLS, {}, {})
    run_episode(Tree(spec), world, context, [capture, recorder, Swaps()], max_time_s=2.1)
    trace = read_trace(tmp_path / "t.jsonl")
    for tick, states in enumerate(capture.states, 1):
        i = trace.index_at(tick)
        told = trace.states(i)
        assert untimed(told) == untimed(states), tick
        if trace.ticks[i].tick == tick:
            for path, state in told.items():
                assert state.elapsed_s == pytest.approx(states[path].elapsed_s, abs=1e-9), (tick, path)


def test_what_a_swap_took_away_is_forgotten(tmp_path: Path) -> None:
    """A path that a later swap brings back begins as any other, whoever wrote the trace."""
    both, one = (
        {"tree": "t", "root": {"parallel": None, "policy": "success_on_all", "children": c}}
        for c in ([{"wait": 1}, {"say": "x"}], [{"wait": 1}, {"wait": 2}])
    )
    said = {"parallel/say": {"status": "SUCCESS", "feedback": "x"}}
    lines = [
        {"trace": 1, "mpvi_bt": "0", "tree": both},
        {"tick": 1, "time_s": 0.0, "nodes": said},
        {"tick": 2, "time_s": 0.1, "tree": one},
        {"tick": 3, "time_s": 0.2, "tree": both},
    ]
    (tmp_path / "t.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    trace = read_trace(tmp_path / "t.jsonl")
    assert [trace.states(i).get("parallel/say") for i in range(3)] == [NodeState("SUCCESS", "x"), None, NodeState()]


def test_the_deepest_tree_can_be_traced(tmp_path: Path) -> None:
    """JSON nests two levels a node, of which readers bear only so many."""
    root: dict[str, Any] = {"say": "hello"}
    for _ in range(MAX_DEPTH - 1):
        root = {"sequence": None, "memory": True, "children": [root]}
    spec = from_expanded({"tree": "t", "root": root})
    episode(spec, tmp_path / "t.jsonl")
    assert read_trace(tmp_path / "t.jsonl").tree == spec
    with pytest.raises(FileProblems, match="one below the other"):
        from_expanded({"tree": "t", "root": {"invert": None, "child": root}})


def test_what_changes_after_a_tick_is_recorded_with_it(tmp_path: Path) -> None:
    """A tick has a second line where its end finds more changed; the last one holds."""

    def spoil(tree: Tree) -> None:
        tree.context.blackboard["extra"] = 1
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        episode(FETCH, tmp_path / "t.jsonl", At(1, spoil))
    trace = read_trace(tmp_path / "t.jsonl")
    assert [change.tick for change in trace.ticks] == [1, 1]
    assert trace.blackboard(trace.index_at(1)) == {"cups": 0, "extra": 1}


def test_a_resumed_run_is_recorded_from_where_it_goes_on(tmp_path: Path) -> None:
    """Its trace begins with how everything stands: ticks, times and values go on, old questions are not asked again."""
    world = KinematicWorld()
    context = scripted_context(world, SKILLS, {"cup": (0.5, 0.2)}, {"the cup is held": (False,)})
    stood: list[SavedTree] = []
    run_episode(Tree(FETCH), world, context, [At(91, lambda tree: stood.append(save(tree)))], max_time_s=3)
    (saved,) = stood
    assert len(context.log.queries) == 1
    capture = Capture()
    for _ in range(90):
        world.step()
    run_episode(Tree(FETCH), world, context, [Recorder(tmp_path / "t"), capture], saved=saved)
    trace = read_trace(tmp_path / "t")
    assert trace.ticks[0].tick == saved.ticks + 1
    assert trace.blackboard(0) == {"cups": 0}
    timeout = "fetch/get the cup/timeout"
    assert trace.states(0)[timeout].elapsed_s == pytest.approx(capture.states[0][timeout].elapsed_s)
    assert 0.9 < (capture.states[0][timeout].elapsed_s or 0) < 1.1
    assert trace.ticks[0].queries == ()
    end = trace.states(-1)[timeout]
    assert end.status == "FAILURE"
    assert end.elapsed_s == pytest.approx(3.0)


def test_equal_runs_write_equal_traces(tmp_path: Path) -> None:
    """But for wall times and the date, not a byte differs."""

    def lines(name: str) -> list[dict[str, Any]]:
        episode(FETCH, tmp_path / name, answers=(False,))
        read = (tmp_path / name).read_text().splitlines()
        return [json.loads(line, object_hook=timeless) for line in read]

    def timeless(data: dict[str, Any]) -> dict[str, Any]:
        return {key: value for key, value in data.items() if key != "started" and not key.startswith("wall_")}

    first = lines("a.jsonl")
    assert json.dumps(first) == json.dumps(lines("b.jsonl"))


def test_back_is_as_forward(tmp_path: Path) -> None:
    """States do not depend on the order in which ticks are looked at, across snapshots too."""
    spec = from_expanded({"tree": "t", "root": {"repeat": 400, "child": {"set": "k", "add": 1}}})
    episode(spec, tmp_path / "t.jsonl")
    trace = read_trace(tmp_path / "t.jsonl")
    n = len(trace.ticks)
    assert n == 400
    forward = [(trace.states(i), trace.blackboard(i)) for i in range(n)]
    assert [b["k"] for _, b in forward] == list(range(1, n + 1))
    trace = read_trace(tmp_path / "t.jsonl")
    assert [(trace.states(i), trace.blackboard(i)) for i in reversed(range(n))] == forward[::-1]
    jumps = [0, n - 1, 255, 256, 257, 3, -1, -n, 300]
    assert [(trace.states(i), trace.blackboard(i)) for i in jumps] == [forward[i] for i in jumps]
    for beyond in (n, -n - 1):
        with pytest.raises(IndexError):
            trace.states(beyond)


def test_stepping_back_through_a_long_trace_is_quick(tmp_path: Path) -> None:
    """A step back costs at most the ticks since a snapshot: the whole way back is not quadratic."""
    head = {"trace": 1, "mpvi_bt": "0", "tree": {"tree": "t", "root": {"say": "x"}}}
    lines = [head, *({"tick": i, "time_s": i / 30, "blackboard": {"k": i}} for i in range(1, 20_001))]
    (tmp_path / "t.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    trace = read_trace(tmp_path / "t.jsonl")
    assert trace.blackboard(19_999) == {"k": 20_000}
    before = time.process_time()
    for i in reversed(range(19_800, 20_000)):
        assert trace.blackboard(i) == {"k": i + 1}
    assert time.process_time() - before < 2  # 0.2 s here; 20 s if it began anew each time


def test_any_prefix_reads_up_to_its_last_whole_line(tmp_path: Path) -> None:
    """However a kill cuts the file, what was written whole is there, and the trace is known to be cut."""
    episode(FETCH, tmp_path / "t.jsonl", answers=(False,))
    raw = (tmp_path / "t.jsonl").read_bytes()
    whole = read_trace(tmp_path / "t.jsonl")
    states = [whole.states(i) for i in range(len(whole.ticks))]
    header = raw.index(b"\n")
    cut = tmp_path / "cut.jsonl"
    for length in [*range(header, len(raw), 37), *(i + d for i, c in enumerate(raw) if c == 10 for d in (0, 1, 2))]:
        cut.write_bytes(raw[:length])
        trace = read_trace(cut)
        lines = raw[:length].count(b"\n") + (raw[length : length + 1] == b"\n")  # a line needs no line end to be whole
        assert len(trace.ticks) == min(lines - 1, len(whole.ticks))
        assert trace.cut == (lines < len(whole.ticks) + 2)
        if trace.ticks:
            assert trace.states(-1) == states[len(trace.ticks) - 1]
    cut.write_bytes(raw[: header // 2])
    with pytest.raises(FileProblems, match="cut off within its first line"):
        read_trace(cut)


def test_a_killed_run_leaves_a_trace(tmp_path: Path) -> None:
    """SIGKILL in the middle of a run costs the line being written at most."""
    code = f"""
import sys; sys.path.insert(0, {str(Path(__file__).parent.parent)!r})
from tests.test_trace import *
spec = from_expanded({{"tree": "t", "root": {{"repeat": 1000000, "child": {{"set": "k", "add": 1}}}}}})
class Tell(Watcher):
    def step(self, tree, world):
        if tree.context.blackboard["k"] % 100 == 0:
            print(tree.context.blackboard["k"], flush=True)
episode(spec, Path({str(tmp_path / "t.jsonl")!r}), Tell(), max_time_s=1e9)
"""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for _ in range(5):
            told = int(process.stdout.readline())
        os.kill(process.pid, signal.SIGKILL)
    trace = read_trace(tmp_path / "t.jsonl")
    assert trace.cut
    last = trace.blackboard(-1)["k"]
    assert isinstance(last, int)
    assert last >= told == 500


def test_what_json_does_not_have_is_written_as_text(tmp_path: Path) -> None:
    """Infinity, paths, and text that is no Unicode leave the file valid JSON."""

    def spoil(tree: Tree) -> None:
        tree.context.blackboard.update(low=-math.inf, odd=math.nan, name="half \ud83d a face")

    episode(FETCH, tmp_path / "t.jsonl", At(3, spoil), limit=math.inf, out=tmp_path, nested=[{1: math.nan}])

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    for line in (tmp_path / "t.jsonl").read_text(encoding="utf-8").splitlines():
        json.loads(line, parse_constant=refuse)
    trace = read_trace(tmp_path / "t.jsonl")
    assert trace.config == {"limit": "inf", "out": str(tmp_path), "nested": [{"1": "nan"}]}
    assert trace.blackboard(-1) == {"cups": 0, "low": "-inf", "odd": "nan", "name": "half ? a face"}


HEAD = json.dumps({"trace": 1, "mpvi_bt": "0", "tree": {"tree": "t", "root": {"say": "x"}}})
ONE = '{"tick": 1, "time_s": 0.0, "nodes": {"say": {"status": "RUNNING"}}}'
END = '{"end": "success", "tick": 3, "time_s": 0.1}'


@pytest.mark.parametrize(
    ("lines", "line", "message"),
    [
        ([""], 1, "no trace"),
        (["tree: t"], 1, "no trace"),
        (['{"a": 1}'], 1, "no trace"),
        (["[" * 5000], 1, "no trace"),
        ([HEAD.replace('"trace": 1', '"trace": 2')], 1, "version 2 of the format; this mpvi_bt reads version 1"),
        ([HEAD.replace("say", "sing")], 1, "unknown node 'sing'"),
        ([HEAD.replace('"mpvi_bt": "0", ', "")], 1, "mpvi_bt"),
        ([HEAD, "{", END], 2, "Invalid JSON"),
        ([HEAD, ONE, "", END], 3, "Invalid JSON"),
        ([HEAD, ONE.replace("RUNNING", "BUSY")], 2, "nodes.say.status"),
        ([HEAD, ONE.replace("0.0", "NaN")], 2, "time_s"),
        ([HEAD, ONE.replace('{"status"', '{"elapsed_s": Infinity, "status"')], 2, "nodes.say.elapsed_s"),
        ([HEAD, ONE.replace("0.0", '"0.0"')], 2, "time_s"),
        ([HEAD, ONE.replace('"say"', '"sing"')], 2, "the tree has no node 'sing'"),
        ([HEAD, ONE.replace("1,", "2,"), ONE], 3, "tick 1 after tick 2"),
        ([HEAD, ONE, END, ONE.replace("1,", "9,")], 4, "after the one that ends"),
        ([HEAD, END.replace("success", "glory")], 2, "end"),
        ([HEAD, '{"tick": 1, "time_s": 0, "blackboard": {"k": [1]}}'], 2, "blackboard.k"),
        ([HEAD, '{"tick": 1, "time_s": 0, "blackboard": {"k": "\\ud800"}}'], 2, "Invalid JSON"),
        ([HEAD, '{"tick": 1, "time_s": 0, "tree": {"tree": "t"}}'], 2, "root"),
    ],
)
def test_what_is_no_trace_is_refused_with_its_line(tmp_path: Path, lines: list[str], line: int, message: str) -> None:
    """A file that is no trace, of another version, or broken before its end names the line and what is wrong."""
    (tmp_path / "t.jsonl").write_text("\n".join(lines) + "\n")
    with pytest.raises(FileProblems) as caught:
        read_trace(tmp_path / "t.jsonl")
    problem = caught.value.problems[0]
    assert problem.line == line
    assert message in problem.message


def test_a_kind_of_another_package_is_told_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the package is not installed, one problem says which one the trace needs."""
    dance = replace(node_types()["wait"], kind="dance", factory="my_robot.dancing:Dance")
    point = SimpleNamespace(name="dance", value="my_robot:DANCE", load=lambda: dance)
    monkeypatch.setattr("mpvi_bt.executive.behaviors.registry.metadata.entry_points", lambda group: [point])
    node_types.cache_clear()
    file = tmp_path / "t.jsonl"
    rules = tmp_path / "rules.yaml"
    rules.write_text("substitute:\n  - nodes: '*'\n    succeed:\n")
    tree = dry_tree(parse_tree("tree: t\nroot:\n  dance: 1\n"), load_rules(rules))
    run_dry(tree, subscribers=[Recorder(file)])
    assert read_trace(file).tree.root.kind == "dance"
    monkeypatch.undo()
    node_types.cache_clear()
    with pytest.raises(FileProblems) as refused:
        read_trace(file)
    (problem,) = refused.value.problems
    assert problem.message == "its nodes of kind 'dance' are of package 'my_robot', which is not installed"


def test_a_trace_that_is_too_large_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before it fills the memory."""
    (tmp_path / "t.jsonl").write_text("\n".join([HEAD, ONE, END]))
    read_trace(tmp_path / "t.jsonl")
    monkeypatch.setattr("mpvi_bt.executive.trace.read.MAX_BYTES", len(HEAD) + 10)
    with pytest.raises(FileProblems, match="larger than"):
        read_trace(tmp_path / "t.jsonl")


def test_keys_that_a_reader_does_not_know_are_passed_over(tmp_path: Path) -> None:
    """A later version may add keys within version 1 of the format."""
    text = "\n".join([HEAD.replace('"seed"', '"x"'), ONE.replace('"tick"', '"new": [1], "tick"'), END])
    (tmp_path / "t.jsonl").write_text(text.replace('{"status"', '{"color": "red", "status"'))
    trace = read_trace(tmp_path / "t.jsonl")
    assert trace.states(0) == {"say": NodeState("RUNNING")}
    assert trace.end is not None


def test_an_empty_or_missing_file_is_a_users_error(tmp_path: Path) -> None:
    """Nothing there, nothing in it, a folder."""
    (tmp_path / "t.jsonl").touch()
    with pytest.raises(FileProblems, match="empty"):
        read_trace(tmp_path / "t.jsonl")
    with pytest.raises(UserError, match="no such file"):
        read_trace(tmp_path / "missing.jsonl")
    with pytest.raises(UserError, match="directory"):
        read_trace(tmp_path)


def test_what_is_no_trace_leads_to_the_one_that_is(tmp_path: Path) -> None:
    """A folder of runs to its newest, a result to the trace beside it."""
    for age, name in enumerate(("new", "old")):
        (tmp_path / f"{name}.trace.jsonl").touch()
        os.utime(tmp_path / f"{name}.trace.jsonl", (1000 - age, 1000 - age))
    (tmp_path / "old.json").write_text("{}")
    with pytest.raises(UserError, match=r"is a directory; its newest trace is .*new\.trace\.jsonl$"):
        read_trace(tmp_path)
    with pytest.raises(FileProblems, match=r"no trace of a run.*that run is .*old\.trace\.jsonl"):
        read_trace(tmp_path / "old.json")


def test_a_full_disk_ends_the_run_with_one_line() -> None:
    """It is a fault of the machine, which names the file."""
    with pytest.raises(BackendError, match="/dev/full: cannot be written: no space left on device"):
        episode(FETCH, Path("/dev/full"))


def test_a_trace_that_cannot_be_written_is_a_users_error(tmp_path: Path) -> None:
    """The file and the reason are named; folders that are missing are made."""
    (tmp_path / "file").touch()
    with pytest.raises(UserError, match=r"t\.jsonl: cannot be written: file exists"):
        episode(FETCH, tmp_path / "file" / "t.jsonl")
    episode(FETCH, tmp_path / "new" / "folder" / "t.jsonl", max_time_s=0.1)
    assert read_trace(tmp_path / "new" / "folder" / "t.jsonl").end is not None


DOCUMENT = (Path(__file__).parent.parent / "docs" / "trace.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("heading", "kind"),
    [
        ("The first line", Header),
        ("A tick", Tick),
        ("A node's state", NodeState),
        ("A query", CheckerAnswer),
        ("A new plan", Replanned),
        ("A handoff", Handoff),
        ("The last line", End),
    ],
)
def test_every_key_is_documented(heading: str, kind: type) -> None:
    """The document's tables name each key that is read, in order, and those that are never absent as such."""
    section = DOCUMENT.split(f"### {heading}\n")[1].split("\n#")[0]
    rows = re.findall(r"^\| `(\w+)` \| [^|]+ \| ([^|]+) \|", section, flags=re.MULTILINE)
    required = {field.name for field in fields(kind) if field.default is MISSING and field.default_factory is MISSING}
    named = ["ending" if key == "end" else key for key, _ in rows]
    assert sorted(named) == sorted(field.name for field in fields(kind))
    never = {key for key, (_, absent) in zip(named, rows, strict=True) if absent == "never"}
    assert never == required | ({"status"} if kind is NodeState else set())


def test_the_documents_example_is_what_is_written(tmp_path: Path) -> None:
    """The tree in the document leaves the trace in the document, and explain says what the document says."""
    tree, written, explained = re.findall(r"^```\w+\n(.*?)^```", DOCUMENT, flags=re.MULTILINE | re.DOTALL)
    world = KinematicWorld()
    run_episode(Tree(parse_tree(tree)), world, scripted_context(world, {}, {}, {}), [Recorder(tmp_path / "t", seed=0)])

    def timeless(text: str) -> str:
        return re.sub(r'"(wall_s|started|mpvi_bt)": [^,}]+', "", text)

    assert timeless((tmp_path / "t").read_text()) == timeless(written)
    assert explanation_text(explain(read_trace(tmp_path / "t"))) + "\n" == explained
