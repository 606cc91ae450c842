"""A new plan where a part of the old one failed: asked for without stopping the loop, swapped in between ticks."""

from __future__ import annotations

import io
import json
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from mpvi_bt.executive.behaviors.context import Context
from mpvi_bt.executive.behaviors.question import HANDOVER_S
from mpvi_bt.executive.language.chat import Answer
from mpvi_bt.executive.plan.history import History, SeenObject
from mpvi_bt.executive.plan.planners import NoPlan, Planned
from mpvi_bt.executive.plan.schema import Plan
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.ticking.debugger import Debugger
from mpvi_bt.executive.ticking.dry import EmptyWorld, dry_context
from mpvi_bt.executive.ticking.live import LiveTree
from mpvi_bt.executive.ticking.loop import Outcome, Subscriber, Watcher, World, run_episode
from mpvi_bt.executive.ticking.replanning import Replanner
from mpvi_bt.executive.ticking.saved_run import SavedRun, restore_world, save_run
from mpvi_bt.executive.trace.diff import diff
from mpvi_bt.executive.trace.explain import explain
from mpvi_bt.executive.trace.explain_text import explanation_text
from mpvi_bt.executive.trace.html import trace_page
from mpvi_bt.executive.trace.read import read_trace
from mpvi_bt.executive.tree.build import Substitute, Tree
from mpvi_bt.executive.tree.compile import compile_plan
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.executive.tree.substitute import Rules, check_rules, stand_ins
from mpvi_bt.executive.tree.yaml_io import expanded, from_expanded, parse_tree
from mpvi_bt.ground.errors import BackendError, ModelError, MpviError, NodeError, UserError
from mpvi_bt.ground.marked_yaml import parse_marked
from mpvi_bt.runs.recording.recorder import Recorder

SKILLS = load_skills()


def plan(*said: str) -> Plan:
    """A plan whose segments drive to what begins with "go", and handle the others."""
    segments = [
        {"type": "navigation", "description": text, "completion_criterion": "there", "target": text[6:]}
        if text.startswith("go to ")
        else {"type": "manipulation", "description": text, "completion_criterion": f"{text} is so"}
        for text in said
    ]
    return Plan.model_validate({"task_name": "tidy", "instruction": "Tidy up.", "segments": segments})


OLD = plan("go to the cup", "pick up the cup", "go to the bin", "put the cup in the bin", "go to the door")
NEW = plan("go to the shelf", "put the cup on the shelf")


@dataclass
class Says:
    """A planner that says what it is told to, the last for good; None: nothing is left to do."""

    answers: Sequence[Plan | Exception | None]
    latency_s: float = 0.0
    remote: bool = False
    name: str = "says"
    told: list[str] = field(default_factory=list)

    def ask(self, task_name: str, instruction: str, history: History | None = None) -> Planned:
        assert (task_name, instruction) == ("tidy", "Tidy up.")
        said = self.answers[min(len(self.told), len(self.answers) - 1)]
        self.told.append(history.text() if history else "")
        answers = (Answer("", "m", self.latency_s / 2, 10, 1), Answer("", "m", self.latency_s / 2, 20, 2))
        if isinstance(said, NoPlan):
            raise NoPlan(said.reason, str(said), answers)
        if isinstance(said, Exception):
            raise said
        if said is None:
            raise NoPlan("nothing_left", "nothing is left", answers)
        return Planned(said, answers)


def rules(*failing: str) -> Rules:
    """Stand-ins that fail."""
    text = "substitute:\n" + "".join(f"  - {{nodes: '{glob}', fail: no_way, after: 1.0}}\n" for glob in failing)
    return check_rules(*parse_marked(text, "rules.yaml"))


@dataclass
class Run:
    """An episode with stand-ins."""

    tree: Tree
    outcome: Outcome
    context: Context
    saved: SavedRun | None = None


def episode(
    planner: Says | None,
    *failing: str,
    spec: TreeSpec | None = None,
    watchers: Iterable[Subscriber] = (),
    stop: Callable[[Tree], bool] = lambda tree: False,
    saved: SavedRun | None = None,
    seen: Iterable[SeenObject] = (),
    max_time_s: float = 60.0,
) -> Run:
    """Run the old plan; nodes that `failing` fit fail after a second."""
    tree = Tree(spec or compile_plan(OLD, SKILLS, "replan"), dry_rules(*failing))
    world = EmptyWorld()
    context = dry_context(world, tree, SKILLS)
    if planner is not None:
        context.replanning = Replanner(planner, tree, context, seen=lambda: seen)
    if saved is not None:
        restore_world(saved, world, context)
    kept: list[SavedRun] = []

    def stops() -> bool:
        if not stop(tree):
            return False
        kept.append(save_run(tree, world))
        return True

    outcome = run_episode(
        tree, world, context, list(watchers), max_time_s, stop=stops, saved=saved.tree if saved else None
    )
    return Run(tree, outcome, context, *kept)


def dry_rules(*failing: str) -> Substitute:
    """What puts stand-ins into a tree."""
    return stand_ins(rules(*failing) if failing else None, dry=True)


def units(tree: Tree) -> list[tuple[str, str]]:
    """Name and status of the root's children; "gave up" for a success that passes over a failure."""
    states = tree.states()
    rows = (states[path] for path in tree.spec.nodes[0].children)
    return [
        (child.name, "gave up" if state.gave_up else state.status.lower())
        for child, state in zip(tree.spec.root.children, rows, strict=True)
    ]


def test_the_new_plan_takes_the_place_of_the_rest() -> None:
    """What is done stays, what failed is given up, and the new units follow, numbered on; they are what runs."""
    planner = Says([NEW])
    run = episode(planner, "*/2 */check_complete")
    assert units(run.tree) == [
        ("1 go to the cup", "success"),
        ("2 pick up the cup", "gave up"),
        ("3 go to the shelf", "success"),
        ("4 put the cup on the shelf", "success"),
    ]
    assert [child.segments for child in run.tree.spec.root.children] == [(0,), (1,), (2,), (3,)]
    assert (run.outcome.ending, run.outcome.complete) == ("success", False)
    assert [failure.reason for failure in run.outcome.log.failures] == ["no_way"]
    (replan,) = run.outcome.log.replans
    assert (replan.path, replan.segments, replan.said) == ("tidy/2 pick up the cup", 2, "")
    assert from_expanded(expanded(run.tree.spec)) == run.tree.spec


def test_the_planner_is_told_what_is_done_what_failed_and_what_was_seen() -> None:
    """Also of what was given up before; and what would have come next."""
    planner = Says([plan("go to the sink", "pick up the fork"), NEW])
    cup = SeenObject("cup", "kitchen", held=True)
    episode(planner, "*/2 */check_complete", "*/4 */check_complete", seen=[cup])
    first, second = planner.told
    assert first == (
        'Failed just now: {"what": "pick up the cup", "came_to": "given up", "reason": "no_way", '
        '"evidence": "substituted by rules.yaml:2"}\n'
        'What came before it, in order:\n- {"what": "go to the cup", "came_to": "done"}\n'
        'What was planned to come after it:\n- "go to the bin"\n- "put the cup in the bin"\n- "go to the door"\n'
        'Things that the robot has seen:\n- {"name": "cup", "room": "kitchen", "held": true}'
    )
    assert '"what": "pick up the fork", "came_to": "given up"' in second.splitlines()[0]
    assert [line.split(", ")[0][11:] for line in second.splitlines()[2:5]] == [
        '"go to the cup"',
        '"pick up the cup"',
        '"go to the sink"',
    ]
    assert "What was planned to come after it: nothing." in second


def test_a_failure_that_took_its_time_takes_it_again() -> None:
    """Answers that hold no plan come when they came; so a run with answers on file ticks as the live one did."""
    error = NoPlan("bad_answer", "three times nonsense", ())
    run = episode(Says([error], latency_s=0.5), "*/2 */check_complete")
    (replan,) = run.outcome.log.replans
    assert (replan.segments, replan.said, replan.latency_s) == (None, "three times nonsense", 0.5)
    assert replan.cost is not None
    assert (replan.cost.model, replan.cost.tokens_in, replan.cost.tokens_out) == ("m", 30, 3)
    at_once = episode(Says([error]), "*/2 */check_complete")
    assert run.outcome.ticks == at_once.outcome.ticks + 15


@pytest.mark.parametrize("failing", ["*/1 */navigate", "*/5 */navigate"])
def test_the_first_and_the_last_unit_can_fail(failing: str) -> None:
    """A plan may follow the last one."""
    run = episode(Says([NEW]), failing)
    assert [name for name, _ in units(run.tree)][-1].endswith("put the cup on the shelf")
    assert run.outcome.ending == "success"


def test_nothing_may_be_left_to_do() -> None:
    """A planner that says so ends the tree: what was to come is taken out, and nothing takes its place."""
    run = episode(Says([None]), "*/2 */check_complete")
    assert units(run.tree) == [("1 go to the cup", "success"), ("2 pick up the cup", "gave up")]
    assert run.outcome.ending == "success"
    assert run.outcome.log.replans[0].segments == 0


def test_a_plan_that_repeats_what_failed_is_bounded() -> None:
    """The planner is asked three times; then the old plan advances."""
    planner = Says([plan("pick up the cup", "go to the door")])
    run = episode(planner, "*/*pick*/check_complete")
    assert len(planner.told) == 3
    assert units(run.tree)[1:] == [(f"{n} pick up the cup", "gave up") for n in (2, 3, 4, 5)] + [
        ("6 go to the door", "success")
    ]
    assert run.tree.states()["tidy/5 pick up the cup"].feedback == (
        "gave up: no_way; no new plan: 3 were asked for already"
    )


@pytest.mark.parametrize("remote", [False, True])
@pytest.mark.parametrize("error", [ModelError("endpoint_down", "nobody there"), UserError("no plan")])
def test_a_planner_that_fails_lets_the_old_plan_advance(error: MpviError, remote: bool) -> None:
    """The log says why; the tree is as it was."""
    planner = Says([error], remote=remote)
    spec = compile_plan(OLD, SKILLS, "replan")
    run = episode(planner, "*/2 */check_complete", spec=spec)
    assert run.tree.spec is spec
    assert [status for _, status in units(run.tree)] == ["success", "gave up", "success", "success", "success"]
    (replan,) = run.outcome.log.replans
    assert (replan.segments, replan.said) == (None, str(error))


def test_a_planner_that_is_broken_is_an_error_of_the_attempt() -> None:
    """What is no MpviError ends the episode, and names the node that asked."""
    with pytest.raises(NodeError, match="tidy/2 pick up the cup"):
        episode(Says([ZeroDivisionError("oops")]), "*/2 */check_complete")


def test_without_a_planner_the_plan_advances() -> None:
    """As in a dry run of a tree that says replan."""
    run = episode(None, "*/2 */check_complete")
    assert [status for _, status in units(run.tree)] == ["success", "gave up", "success", "success", "success"]


@pytest.mark.parametrize("remote", [False, True])
def test_the_answer_takes_its_time_and_the_robot_waits(remote: bool) -> None:
    """The attempt runs on for as much simulated time as the planner took; nothing else is ticked meanwhile."""
    ticked: list[tuple[float, str]] = []

    class Looks(Watcher):
        def step(self, tree: Tree, world: World) -> None:
            waiting = tree.nodes["tidy/2 pick up the cup"]
            if waiting.status.value == "RUNNING" and "asking" in waiting.feedback_message:
                ticked.append((world.time_s, tree.touched[-2].name))

    began = time.monotonic()
    run = episode(Says([NEW], latency_s=0.5, remote=remote), "*/2 */check_complete", watchers=[Looks()])
    ticks = round((0.5 + (HANDOVER_S if remote else 0.0)) * 30) + 1
    assert [round(time_s - ticked[0][0], 3) for time_s, _ in ticked] == [round(i / 30, 3) for i in range(ticks)]
    assert {name for _, name in ticked} == {"2 pick up the cup"}
    assert run.outcome.log.replans[0].latency_s == 0.5
    assert time.monotonic() - began < 5
    assert units(run.tree)[-1] == ("4 put the cup on the shelf", "success")


def test_a_slow_planner_does_not_stop_the_loop() -> None:
    """The loop ticks on, held to real time, while the planner thinks."""

    class Thinks(Says):
        def ask(self, task_name: str, instruction: str, history: History | None = None) -> Planned:
            time.sleep(0.3)
            return super().ask(task_name, instruction, history)

    run = episode(Thinks([NEW], latency_s=0.3, remote=True), "*/2 */check_complete")
    assert 0.25 < run.outcome.wall_s["total"] < 5
    assert units(run.tree)[-1] == ("4 put the cup on the shelf", "success")


def test_an_attempt_that_is_interrupted_forgets_its_plan() -> None:
    """A timeout above ends the waiting, and an answer that comes later changes nothing."""
    spec = parse_tree(
        "tree: tidy\ninstruction: Tidy up.\nroot:\n  sequence: all\n  memory: true\n  children:\n"
        "    - attempt: limited\n      child:\n        timeout: 1.5\n        child:\n          sequence: inner\n"
        "          memory: true\n          children:\n"
        "            - {attempt: a, on_failure: replan, child: {navigate: x}}\n"
        "    - wait: 3\n"
    )
    run = episode(Says([NEW], latency_s=1.0), "*/navigate", spec=spec)
    assert run.tree.spec is spec
    assert run.outcome.log.replans == []
    assert [failure.reason for failure in run.outcome.log.failures] == ["no_way", "timeout"]


def test_an_attempt_elsewhere_has_no_rest_to_replace() -> None:
    """Outside of a sequence with memory it advances, and says why."""
    spec = parse_tree("tree: tidy\nroot: {attempt: a, on_failure: replan, child: {navigate: x}}\n")
    run = episode(Says([NEW]), "*/navigate", spec=spec)
    assert run.tree.states()["a"].feedback == "gave up: no_way; no new plan: it is no child of a sequence with memory"


def test_the_longest_plan_is_swapped_in() -> None:
    """200 segments, three times over, and the tree is one that can be read back."""
    long = plan(*["go to the cup", "pick up the cup"] * 99, "go to the cup", "wave")
    run = episode(Says([long]), "*/navigate", max_time_s=400.0)
    assert len(run.outcome.log.replans) == 3
    assert len(run.tree.spec.root.children) == 3 + 200
    assert from_expanded(expanded(run.tree.spec)) == run.tree.spec


def test_a_retry_is_in_the_tree() -> None:
    """`retry:2` is the tree's own decorator: a unit is begun three times, each with all of its time."""
    spec = compile_plan(OLD, SKILLS, "retry:2")
    assert spec.root.children[1].children[0].kind == "retry"
    run = episode(None, "*/2 */check_complete", spec=spec)
    (failure,) = run.outcome.log.failures
    assert failure.reason == "out_of_tries"
    assert run.outcome.time_s == pytest.approx(2 + 3 * 1 + 3 * 2, abs=0.2)


# ------------------------------------------------------------------------------------------ what readers make of it


def test_a_trace_tells_of_the_swap(tmp_path: Path) -> None:
    """Replay, explain, diff and the page have the old tree before it, the new one after it, and what was answered."""
    file = tmp_path / "t.jsonl"
    run = episode(Says([NEW], latency_s=0.5), "*/2 */check_complete", watchers=[Recorder(file)])
    trace = read_trace(file)
    (told,) = (replan for tick in trace.ticks for replan in tick.replans)
    assert (told.path, told.segments, told.latency_s) == ("tidy/2 pick up the cup", 2, 0.5)
    assert told.asked_s == pytest.approx(3.0, abs=0.1)
    assert [tick.tree is not None for tick in trace.ticks].count(True) == 1
    assert trace.tree_at(-1) == run.tree.spec
    assert trace.states(-1) == run.tree.states()
    text = explanation_text(explain(trace))
    assert "1 unit was given up on the way:" in text
    assert "then a new plan of 2 segments, answered in 0.5 s" in text
    assert diff(trace, trace).same
    page = trace_page(trace)
    assert "3 go to the bin" in page
    assert "3 go to the shelf" in page
    again = episode(Says([NEW], latency_s=0.5), "*/2 */check_complete", watchers=[Recorder(tmp_path / "u.jsonl")])
    assert diff(trace, read_trace(tmp_path / "u.jsonl")).same
    assert again.outcome.ticks == run.outcome.ticks
    without = episode(None, "*/2 */check_complete", watchers=[Recorder(tmp_path / "v.jsonl")])
    assert without.outcome.ending == "success"
    parted = diff(trace, read_trace(tmp_path / "v.jsonl"))
    assert parted.tick is not None


def test_a_trace_tells_why_there_is_no_plan(tmp_path: Path) -> None:
    """Beside the unit that was given up."""
    file = tmp_path / "t.jsonl"
    episode(Says([BackendError("the endpoint is down")]), "*/2 */check_complete", watchers=[Recorder(file)])
    assert "then no new plan: the endpoint is down" in explanation_text(explain(read_trace(file)))


def test_the_live_tree_shows_the_swap() -> None:
    """Piped, the whole new tree, and then its changes."""
    stream = io.StringIO()
    episode(Says([NEW]), "*/2 */check_complete", watchers=[LiveTree(stream)])
    before, _, after = stream.getvalue().partition("3 go to the shelf")
    assert "3 go to the bin" in before
    assert "3 go to the bin" not in after
    assert "attempt or replan: 2 pick up the... [!]  gave up: no_way;" in after


def test_breaks_are_for_the_new_part_too() -> None:
    """A glob that was given at the start stops at nodes that came later."""
    stream = io.StringIO()
    debugger = Debugger(io.StringIO("c\n" * 9), stream, ["*/navigate"])
    episode(Says([NEW]), "*/2 */check_complete", watchers=[debugger])
    assert "break at tidy/3 go to the shelf/timeout/navigate" in stream.getvalue()


def test_rules_are_for_the_new_part_too() -> None:
    """What fits there stands in, and a rule that fits nothing there is no error."""
    run = episode(Says([NEW]), "*/2 */check_complete", "*/3 *shelf/*/navigate", "*/5 */navigate")
    assert units(run.tree)[2] == ("3 go to the shelf", "gave up")


# ------------------------------------------------------------------------------------------ stopping and going on


@pytest.mark.parametrize("latency_s", [0.0, 0.5])
@pytest.mark.parametrize("ticks", [20, 61, 91, 93, 100, 120, 160, 200])
def test_a_run_that_was_stopped_goes_on_with_the_tree_that_it_had(ticks: int, latency_s: float, tmp_path: Path) -> None:
    """Before the failure, while it waits, and after the swap: it ends as if it had not been stopped."""
    failing = ("*/2 */check_complete", "*/4 */check_complete")
    answers = [plan("go to the sink", "pick up the fork"), NEW]
    whole = episode(Says(answers, latency_s), *failing, watchers=[Recorder(tmp_path / "whole.jsonl")])
    first = Recorder(tmp_path / "t.jsonl")
    stopped = episode(Says(answers, latency_s), *failing, watchers=[first], stop=lambda tree: tree.ticks == ticks)
    assert stopped.outcome.ending == "interrupted"
    assert stopped.saved is not None
    saved = SavedRun.model_validate(json.loads(stopped.saved.model_dump_json()))
    spec = from_expanded(json.loads(json.dumps(expanded(stopped.tree.spec))))
    left = answers[len(saved.replans) :] or [NEW]
    second = Recorder(tmp_path / "t.jsonl", saved=saved)
    run = episode(Says(left, latency_s), *failing, spec=spec, saved=saved, watchers=[second])
    assert units(run.tree) == units(whole.tree)
    assert [(r.path, r.segments) for r in run.outcome.log.replans] == [
        (r.path, r.segments) for r in whole.outcome.log.replans
    ]
    assert [f.reason for f in run.outcome.log.failures] == [f.reason for f in whole.outcome.log.failures]
    waited = any(node.feedback_message.endswith("asking for a new plan") for node in stopped.tree.nodes.values())
    assert waited or run.outcome.ticks == whole.outcome.ticks
    told = [(r.path, r.segments) for tick in read_trace(tmp_path / "t.jsonl").ticks for r in tick.replans]
    assert told == [(r.path, r.segments) for r in whole.outcome.log.replans]
