"""Substitution rules: their file, which nodes they fit, and what a stand-in does on the simulation clock."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from py_trees.common import Status

from mpvi_bt.executive.ticking.dry import EmptyWorld, dry_context, dry_tree, run_dry
from mpvi_bt.executive.ticking.loop import Outcome, run_episode
from mpvi_bt.executive.ticking.saved_run import SavedRun, restore_world, save_run
from mpvi_bt.executive.trace.read import read_trace
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.globs import fits
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.executive.tree.substitute import Rules, load_rules, stand_ins
from mpvi_bt.executive.tree.yaml_io import parse_tree
from mpvi_bt.ground.errors import FileProblems, NodeError
from mpvi_bt.runs.recording.recorder import Recorder
from mpvi_bt.testing import KinematicWorld, scripted_context
from tests.layouts import BASE
from tests.test_saving import Journal

FETCH = """
tree: fetch
blackboard: {place: sofa}
root:
  sequence: fetch
  memory: true
  children:
    - navigate: cup
    - timeout: 20
      child:
        until_complete:
        children:
          - manipulate: pick up the cup
          - check_complete: the cup is held in a gripper
    - navigate: $place
    - set: there
      value: true
    - say: done
"""
RETRIED = "    - retry: 3\n      child:\n        wait: 20 steps"
SPEC = parse_tree(FETCH)
LEAVES = [node.path for node in SPEC.nodes if not node.children]


def rules(text: str, folder: Path) -> Rules:
    """The rules of a text."""
    file = folder / "rules.yaml"
    file.write_text(text)
    return load_rules(file)


def dry(spec: TreeSpec, text: str, folder: Path, max_time_s: float = 3600.0) -> Outcome:
    """A dry run with the rules of a text."""
    return run_dry(dry_tree(spec, rules(text, folder)), max_time_s=max_time_s)


def one(path: str, act: str) -> str:
    """A file of one rule."""
    return f"substitute:\n  - nodes: '{path}'\n    {act}\n"


@pytest.mark.parametrize(
    ("glob", "path", "fit"),
    [
        ("a/b", "a/b", True),
        ("a/b", "a/b#2", False),
        ("a", "a/b", False),
        ("*/b", "a/b", True),
        ("*/b", "a/c/b", True),
        ("*/b", "b", True),
        ("*/b", "a/bb", False),
        ("*/b", "a/b#2", True),
        ("*/b#2", "a/b#2", True),
        ("*/b#2", "a/b", False),
        ("*/b/c", "a/b#3/c", True),
        ("**/2 */**/b", "a/2 go/x/b", True),
        ("a/?", "a/b", True),
        ("a/?", "a/bc", False),
        ("*/say [x]", "a/say [x]", True),
        ("*/say [x]", "a/say x", False),
        ("*A", "a", False),
    ],
)
def test_globs(glob: str, path: str, fit: bool) -> None:
    """As their module says."""
    assert fits(glob, path) is fit


@given(st.text(st.characters(codec="utf-8"), min_size=1, max_size=30))
def test_every_path_is_a_glob_for_itself(path: str) -> None:
    """Whatever a node is called, its path as `mpvi render --json` shows it means that node."""
    assert fits(path, path)


def test_a_glob_of_many_stars_is_quick() -> None:
    """Matching takes no exponential time."""
    assert not fits("*a" * 30 + "b", "a" * 3000)


@pytest.mark.parametrize(
    ("text", "place", "said"),
    [
        ("about: x\n", "1:1", "substitute"),
        ("substitute: []\n", "1:13", "1 item or more"),
        ("substitute:\n  - nodes: a\n", "2:5", "not none"),
        ("substitute:\n  - nodes: a\n    succeed:\n    fail: x\n", "2:5", "not succeed, fail"),
        ("substitute:\n  - nodes: a\n    fial: x\n", "3:5", "Did you mean 'fail'?"),
        ("substitute:\n  - nodes: a\n    fail: Not Seen\n", "3:11", ""),
        ("substitute:\n  - nodes: a\n    run: 90 stebs\n", "3:10", "90 steps"),
        ("substitute:\n  - nodes: a\n    delay:\n", "2:5", "'delay' needs a duration"),
        ("substitute:\n  - nodes: a\n    run: 3\n    after: 3\n", "2:5", "'after' does not go with 'run'"),
        ("substitute:\n  - nodes: a\n    succeed:\n    times: 0\n", "4:12", "1"),
        ("substitute:\n  - nodes: a\n    succeed:\n    after: -1\n", "4:12", "0"),
    ],
)
def test_a_broken_file_is_told_with_its_place(text: str, place: str, said: str, tmp_path: Path) -> None:
    """Each problem has line and column, and says what would be valid."""
    with pytest.raises(FileProblems) as caught:
        rules(text, tmp_path)
    problem = caught.value.problems[0]
    assert f"{problem.line}:{problem.column}" == place
    assert said in str(caught.value)


def test_a_rule_that_fits_no_node_is_a_problem(tmp_path: Path) -> None:
    """With the place of its glob and the nearest that fits."""
    text = one("*/navigat", "succeed:") + "  - nodes: fetch/timeuot\n    succeed:\n"
    with pytest.raises(FileProblems) as caught:
        dry_tree(SPEC, rules(text, tmp_path))
    first, second = caught.value.problems
    assert (first.line, first.column, first.code) == (2, 12, "no-such-node")
    assert "Did you mean '*/navigate'?" in first.message
    assert (second.line, second.column) == (4, 12)
    assert "Did you mean 'fetch/timeout'?" in second.message


def test_rules_are_read_without_py_trees(tmp_path: Path) -> None:
    """Checking a file of rules loads neither py_trees nor numpy."""
    rules(one("a", "succeed:"), tmp_path)
    code = (
        "import sys\nfrom mpvi_bt.executive.tree.substitute import load_rules\n"
        "load_rules('rules.yaml')\nprint([m for m in ('py_trees', 'numpy') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.parametrize("path", LEAVES)
def test_a_failure_names_the_node_that_was_told_to_fail(path: str, tmp_path: Path) -> None:
    """A fail rule on each leaf in turn: the root's failure is that leaf's, with the rule's reason and place."""
    outcome = dry(SPEC, one(path, "fail: on_purpose"), tmp_path)
    assert outcome.ending == "failure"
    assert outcome.failure
    assert (outcome.failure.path, outcome.failure.reason) == (path, "on_purpose")
    assert outcome.failure.evidence == f"substituted by {tmp_path / 'rules.yaml'}:2"


@pytest.mark.parametrize("path", [LEAVES[0], *LEAVES[2:]])  # nothing waits for the policy
@given(steps=st.integers(1, 200))
def test_a_delay_shifts_the_end_by_just_so_many_ticks(
    path: str, steps: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Whichever leaf is delayed."""
    folder = tmp_path_factory.mktemp("rules")
    late = dry(SPEC, one(path, f"delay: {steps} steps"), folder)
    assert (late.ending, late.ticks) == ("success", run_dry(dry_tree(SPEC)).ticks + steps)


@pytest.mark.parametrize(("duration", "steps"), [("30 steps", 30), ("1.0", 30), ("0.1", 3), ("1 step", 1)])
@pytest.mark.parametrize(
    ("act", "ending"),
    [("succeed:\n    after: {}", "success"), ("run: {}", "success"), ("fail:\n    after: {}", "failure")],
)
def test_a_stand_in_runs_as_long_as_it_is_told(
    act: str, ending: str, duration: str, steps: int, tmp_path: Path
) -> None:
    """In seconds and in steps, of simulated time: it ends in the first tick in which that has passed."""
    spec = parse_tree("tree: t\nroot:\n  navigate: cup\n")
    outcome = dry(spec, one("navigate", act.format(duration)), tmp_path)
    assert (outcome.ending, outcome.steps) == (ending, steps)


def test_without_a_duration_it_ends_at_once_or_never(tmp_path: Path) -> None:
    """`succeed:` in the first tick; `run:` not at all."""
    spec = parse_tree("tree: t\nroot:\n  navigate: cup\n")
    assert dry(spec, one("navigate", "succeed:"), tmp_path).ticks == 1
    assert dry(spec, one("navigate", "run:"), tmp_path, max_time_s=50.0).ending == "time_limit"


def test_after_its_times_the_next_rule_has_its_turn_and_then_the_node(tmp_path: Path) -> None:
    """Rounds are counted for each node; the real node works as if nothing had stood there."""
    spec = parse_tree("tree: t\nroot:\n  retry: 9\n  child:\n    set: n\n    add: 1\n")
    text = one("*/set", "fail: first\n    times: 2") + "  - nodes: '*/set'\n    fail: second\n    times: 1\n"
    tree = dry_tree(spec, rules(text, tmp_path))
    seen = []

    class Watch:
        def start(self, tree: Tree, world: object) -> None: ...

        def step(self, tree: Tree, world: object) -> None:
            failure = getattr(tree.nodes["retry/set"], "failure", None)
            seen.append(failure.reason if failure else "")

        def end(self, outcome: Outcome) -> None: ...

    assert run_dry(tree, subscribers=[Watch()]).ending == "success"
    assert seen == ["first", "first", "second", ""]
    assert tree.context.blackboard == {"n": 1}


def test_each_round_names_its_rule_and_the_place(tmp_path: Path) -> None:
    """Rules that fail a node for the same reason are told apart, in the trace too, and each failure is that node's."""
    spec = parse_tree("tree: t\nroot:\n  retry: 3\n  child:\n    navigate: sofa\n")
    text = one("*/navigate", "fail: same\n    times: 1") + "  - nodes: '*/navigate'\n    fail: same\n    times: 1\n"
    file = rules(text + "  - nodes: '*/navigate'\n    fail: same\n", tmp_path)
    outcome = run_dry(dry_tree(spec, file), subscribers=[Recorder(tmp_path / "t.jsonl")])
    assert outcome.failure is not None
    assert outcome.failure.cause is not None
    assert outcome.failure.cause.path == "retry/navigate"
    told = [(tick.tick, tick.nodes["retry/navigate"]) for tick in read_trace(tmp_path / "t.jsonl").ticks]
    assert [(tick, state.origin, state.evidence.rpartition(":")[2]) for tick, state in told] == [
        (1, "retry/navigate", "2"),
        (2, "retry/navigate", "5"),
        (3, "retry/navigate", "8"),
    ]


def test_a_node_behind_its_stand_in_goes_with_it_to_another_place(tmp_path: Path) -> None:
    """A swap that renames the stand-in renames what fails behind it."""
    wait = "tree: t\nroot:\n  sequence: s\n  memory: true\n  children:\n    - wait: 1 steps\n"
    spec = parse_tree(f"{wait}    - {{timeout: 0.2, child: {{wait: 9}}}}\n    - {{timeout: 0.1, child: {{wait: 9}}}}\n")
    tree = Tree(spec, stand_ins(rules(one("*/timeout#2", "delay: 1 steps"), tmp_path)))
    tree.setup(dry_context(EmptyWorld(), tree))
    tree.swap("s/timeout", parse_tree("tree: t\nroot:\n  say: hello\n").root)
    world = EmptyWorld()
    outcome = run_episode(tree, world, dry_context(world, tree))
    assert outcome.failure is not None
    assert outcome.failure.path == "s/timeout"


def test_the_first_rule_that_fits_wins(tmp_path: Path) -> None:
    """The order in the file decides."""
    text = one("*/navigate", "fail: one") + "  - nodes: '*'\n    fail: two\n"
    outcome = dry(parse_tree("tree: t\nroot:\n  navigate: cup\n"), text, tmp_path)
    assert outcome.failure
    assert outcome.failure.reason == "one"


def test_a_delayed_composite_works_with_its_children(tmp_path: Path) -> None:
    """After the delay the real node runs, and what is below it is seen and fails under its own path."""
    text = one("fetch/timeout", "delay: 30 steps") + "  - nodes: '*/check_complete'\n    fail: not_seen\n"
    tree = dry_tree(SPEC, rules(text, tmp_path))
    outcome = run_dry(tree)
    assert outcome.failure
    assert outcome.failure.path == "fetch/timeout/until_complete/check_complete"
    assert outcome.time_s == pytest.approx(2.0 + 1.0)
    states = tree.states()
    assert states["fetch/timeout"].limit_s == 20.0
    assert states["fetch/timeout"].origin == outcome.failure.path


def test_what_is_below_a_stand_in_is_not_ticked(tmp_path: Path) -> None:
    """A composite that is told to succeed does nothing of its own."""
    tree = dry_tree(SPEC, rules(one("fetch/timeout", "succeed:"), tmp_path))
    assert run_dry(tree).ending == "success"
    assert "fetch/timeout/until_complete" not in tree.nodes


def test_stand_ins_obey_the_timeouts_around_them(tmp_path: Path) -> None:
    """A check that never answers ends with its timeout, at the timeout's time; the stand-in is interrupted."""
    tree = dry_tree(SPEC, rules(one("*/check_complete", "run:"), tmp_path))
    outcome = run_dry(tree)
    assert outcome.failure
    assert (outcome.failure.reason, outcome.failure.path) == ("timeout", "fetch/timeout")
    assert outcome.time_s == pytest.approx(2.0 + 20.0)
    assert tree.states()["fetch/timeout/until_complete/check_complete"].interrupted


def test_an_interrupted_real_node_is_interrupted_behind_its_stand_in(tmp_path: Path) -> None:
    """A delayed wait that is cut off begins anew, delay and all, in its next round."""
    spec = parse_tree("tree: t\nroot:\n  retry: 2\n  child:\n    timeout: 60 steps\n    child:\n      wait: 45 steps\n")
    outcome = dry(spec, one("*/wait", "delay: 30 steps\n    times: 1"), tmp_path)
    assert (outcome.ending, outcome.steps) == ("success", 60 + 1 + 45)


def test_what_a_tick_touched_are_nodes_of_the_tree(tmp_path: Path) -> None:
    """A node behind its stand-in is none, when it is reset neither: the stand-in is told of in its place."""
    spec = parse_tree("tree: t\nroot:\n  retry: 2\n  child:\n    timeout: 60 steps\n    child:\n      wait: 45 steps\n")
    tree, world = Tree(spec, stand_ins(rules(one("*/wait", "delay: 30 steps\n    times: 1"), tmp_path))), EmptyWorld()
    tree.setup(dry_context(world, tree))
    reset = 0
    while tree.tick() == Status.RUNNING:
        assert set(tree.touched) <= set(tree.nodes.values())
        stand_in = tree.nodes["retry/timeout/wait"]
        reset += stand_in in tree.touched and stand_in.status == Status.INVALID
        world.step()
    assert reset == 1


def test_an_exception_names_the_node_and_its_rule(tmp_path: Path) -> None:
    """`raise` breaks the node as a fault of its own would."""
    with pytest.raises(NodeError) as caught:
        dry(SPEC, one("*/set", "raise: the driver went away"), tmp_path)
    assert caught.value.path == "fetch/set"
    assert "the driver went away (substituted by" in str(caught.value)


def test_after_an_exception_the_robot_holds(tmp_path: Path) -> None:
    """A node that breaks while the robot drives leaves it standing still, and every node is terminated."""
    spec = parse_tree(
        "tree: t\nroot:\n  parallel:\n  policy: success_on_all\n  children:\n    - navigate: cup\n    - wait: 9\n"
    )
    world = KinematicWorld()
    tree = Tree(spec, stand_ins(rules(one("*/wait", "raise: gone\n    after: 9 steps"), tmp_path)))
    context = scripted_context(world, {}, {"cup": (5.0, 0.0)}, {})
    with pytest.raises(NodeError) as caught:
        run_episode(tree, world, context)
    assert caught.value.path == "parallel/wait"
    assert world.robot.proprioception().base_velocity.any()  # it was driving
    assert not world.robot.action[BASE].any()
    assert all(node.status == Status.INVALID for node in tree.nodes.values())


def test_a_stand_in_is_seen_as_one(tmp_path: Path) -> None:
    """Its feedback says so, running and ended; it keeps name and path; its time is shown."""
    tree = dry_tree(SPEC, rules(one("fetch/navigate", "fail: no_path\n    after: 2.0"), tmp_path))
    seen = []

    class Watch:
        def start(self, tree: Tree, world: object) -> None: ...

        def step(self, tree: Tree, world: object) -> None:
            seen.append(tree.states()["fetch/navigate"])

        def end(self, outcome: Outcome) -> None: ...

    run_dry(tree, subscribers=[Watch()])
    assert (seen[0].feedback, seen[0].limit_s) == ("stand-in: will fail", 2.0)
    assert seen[-1].feedback == f"no_path: substituted by {tmp_path / 'rules.yaml'}:2"
    assert seen[-1].elapsed_s == pytest.approx(2.0)
    assert tree.nodes["fetch/navigate"].name == "navigate"


def test_without_rules_nothing_is_substituted() -> None:
    """Outside a dry run every node is the real one."""
    tree = Tree(SPEC, stand_ins())
    assert {type(node).__name__ for node in tree.nodes.values()} >= {"Navigate", "Manipulate", "CheckComplete"}


@pytest.mark.parametrize(
    "text",
    [
        one("*/navigate", "delay: 10 steps"),
        one("fetch/timeout", "delay: 40 steps"),
        one("*/check_complete", "fail: not_seen\n    after: 30 steps\n    times: 1"),
        one("*/wait", "delay: 10 steps") + "  - nodes: '*/wait'\n    fail: x\n    times: 2\n",
    ],
)
@given(tick=st.integers(1, 240))
@settings(max_examples=30)
def test_a_stand_in_goes_on_from_its_saved_state(
    text: str, tick: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Saved after any tick and restored in another process, a run goes on as if it had not been interrupted."""
    file = rules(text, tmp_path_factory.mktemp("rules"))
    spec = parse_tree(FETCH.replace("    - set: there\n      value: true", RETRIED))
    unbroken, rest = Journal(), Journal()
    whole = run_dry(dry_tree(spec, file), subscribers=[unbroken])
    tree, world = dry_tree(spec, file), EmptyWorld()
    kept: list[str] = []

    def stop() -> bool:
        if tree.ticks == tick:
            kept.append(save_run(tree, world).model_dump_json())
        return bool(kept)

    run_episode(tree, world, dry_context(world, tree), stop=stop)
    if not kept:  # it had ended before
        return
    saved = SavedRun.model_validate_json(kept[0])
    again, fresh = dry_tree(spec, file), EmptyWorld()
    context = dry_context(fresh, again)
    restore_world(saved, fresh, context)
    outcome = run_episode(again, fresh, context, [rest], saved=saved.tree)
    assert rest.ticks == unbroken.ticks[tick:]
    assert (outcome.ending, outcome.ticks, outcome.failure) == (whole.ending, whole.ticks, whole.failure)
