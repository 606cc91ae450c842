"""A run that is stopped between two ticks goes on as if it had not been; a subtree is swapped while others go on."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from py_trees.behaviour import Behaviour
from py_trees.common import Status

from mpvi_bt.executive.behaviors.parameters import NavigateTo, SaidText
from mpvi_bt.executive.behaviors.stand_ins import StandIn
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.ticking.dry import EmptyWorld, dry_context
from mpvi_bt.executive.ticking.loop import Outcome, Watcher, World, run_episode
from mpvi_bt.executive.ticking.saved_run import SavedRun, restore_world, save_run
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.saving import restore
from mpvi_bt.executive.tree.spec import NodeSpec, Placed, TreeSpec
from mpvi_bt.executive.tree.state import NodeState
from mpvi_bt.executive.tree.yaml_io import parse_tree
from mpvi_bt.ground.errors import UnknownName, UserError
from mpvi_bt.testing import KinematicWorld, scripted_context

SKILLS = load_skills()
PLACES = {"cup": (1.0, 0.0), "sink": (0.0, 2.0)}
ANSWERS = {"the cup is held in a gripper": (True,)}
LONG = """\
tree: t
blackboard: {laps: 0}
root:
  sequence: day
  memory: true
  children:
    - attempt: never
      child:
        timeout: 0.5
        child:
          wait: 1
    - repeat: 3
      child:
        sequence: lap
        memory: true
        children:
          - wait: 0.4
          - set: laps
            add: 1
    - retry: 3
      child:
        sequence: stubborn
        memory: true
        children:
          - wait: 5 steps
          - set: tries
            add: 1
          - test: tries
            at_least: 3
    - timeout: 30
      child:
        until_complete:
        children:
          - manipulate: pick up the cup
          - check_complete: the cup is held in a gripper
            skill: pick
    - selector: either
      memory: true
      children:
        - test: laps
          at_least: 5
        - timeout: 20 steps
          child:
            parallel: both
            policy: success_on_all
            children:
              - wait: 8 steps
              - wait: 0.5
"""


class Journal(Watcher):
    """Keeps how every node stood after every tick, its time to a microsecond."""

    def __init__(self) -> None:
        self.ticks: list[dict[str, NodeState]] = []

    def step(self, tree: Tree, world: World) -> None:
        """Note it."""
        self.ticks.append(standing(tree))


def standing(tree: Tree) -> dict[str, NodeState]:
    """How every node stands."""
    return {
        path: state if state.elapsed_s is None else replace(state, elapsed_s=round(state.elapsed_s, 6))
        for path, state in tree.states().items()
    }


CHECK = "day/timeout/until_complete/check_complete"


def unit_untimed(ticks: list[dict[str, NodeState]]) -> list[dict[str, NodeState]]:
    """Without the time of the unit that drives a backend, which may take longer when it is begun anew."""
    return [{**tick, "day/timeout": replace(tick["day/timeout"], elapsed_s=None)} for tick in ticks]


def play(
    spec: TreeSpec, stop: Callable[[], bool] = lambda: False, saved: SavedRun | None = None
) -> tuple[Outcome, Journal, SavedRun, Any]:
    """Run until the tree ends or is stopped; how it went, what was seen, and how it stands."""
    world = KinematicWorld()
    context = scripted_context(world, SKILLS, PLACES, ANSWERS)
    context.blackboard.update(spec.blackboard)
    if saved is not None:
        restore_world(saved, world, context)
    tree, journal = Tree(spec), Journal()
    kept: list[SavedRun] = []

    def keep_and_stop() -> bool:
        if stop():
            kept.append(save_run(tree, world))
            return True
        return False

    outcome = run_episode(
        tree, world, context, [journal], max_time_s=60, stop=keep_and_stop, saved=saved.tree if saved else None
    )
    return outcome, journal, kept[0] if kept else save_run(tree, world), context


def after(ticks: int) -> Callable[[], bool]:
    """Says stop once it was asked so often."""
    asked = iter(range(10**9))
    return lambda: next(asked) >= ticks


WHOLE = play(parse_tree(LONG, "t.yaml", SKILLS))


@settings(max_examples=40, deadline=None)
@given(ticks=st.integers(1, len(WHOLE[1].ticks) - 1))
def test_a_saved_run_goes_on_as_if_it_had_not_stopped(ticks: int) -> None:
    """Stopped after any tick, written as JSON and read, it has the same states, time, blackboard and failures.

    Of a unit that drives a backend, which is begun anew, that holds before and after it.
    """
    spec = parse_tree(LONG, "t.yaml", SKILLS)
    first, seen, saved, _ = play(spec, after(ticks))
    assert (first.ending, first.ticks) == ("interrupted", ticks)
    text = json.dumps(saved.model_dump(mode="json"))
    second, rest, _, context = play(spec, saved=SavedRun.model_validate_json(text))
    whole, journal, _, whole_context = WHOLE
    assert seen.ticks == journal.ticks[:ticks]
    if seen.ticks[-1][CHECK].status != "RUNNING":
        assert rest.ticks == journal.ticks[ticks:]
        assert (second.ending, second.ticks, second.time_s) == (whole.ending, whole.ticks, whole.time_s)
    else:
        resumed, unbroken = (
            next(i for i, tick in enumerate(run) if tick[CHECK].status != "RUNNING")
            for run in (rest.ticks, journal.ticks[ticks:])
        )
        assert unit_untimed(rest.ticks[resumed:]) == unit_untimed(journal.ticks[ticks + unbroken :])
        assert second.ticks - whole.ticks == resumed - unbroken
    assert second.ending == whole.ending == "success"
    assert context.blackboard == whole_context.blackboard == {"laps": 3, "tries": 3}
    assert [f.reason for f in context.log.failures] == ["timeout"]


@pytest.mark.parametrize("stands_in", [False, True])
@pytest.mark.parametrize("ticks", [10, 25, 60])
def test_a_restored_tree_stands_as_it_stood(ticks: int, stands_in: bool) -> None:
    """Before it is ticked, too: what was cut off before the stop, and after what time, stand-ins included."""
    spec = parse_tree(
        """\
tree: t
root:
  sequence: s
  memory: true
  children:
    - attempt: cut
      child:
        timeout: 0.5
        child:
          parallel: all
          policy: success_on_all
          children:
            - wait: 9
            - timeout: 8
              child: {wait: 20}
            - {set: n, add: 1}
    - wait: 1
    - wait: 9
""",
        "t.yaml",
    )

    def substitute(placed: Placed, make: Callable[[], Behaviour]) -> Behaviour:
        waits = stands_in and placed.spec.kind == "wait"
        return StandIn("wait", "delay", 0.3, other=make()) if waits else make()

    def ready(world: EmptyWorld, saved: SavedRun | None = None) -> Tree:
        tree = Tree(spec, substitute)
        context = dry_context(world, tree)
        if saved is not None:
            restore_world(saved, world, context)
        tree.setup(context)
        return tree

    world = EmptyWorld()
    tree = ready(world)
    for _ in range(ticks):
        tree.tick()
        world.step()
    saved = SavedRun.model_validate_json(save_run(tree, world).model_dump_json())
    resumed = ready(EmptyWorld(), saved)
    restore(resumed, saved.tree)
    told = standing(tree)
    if ticks > 15:
        cut = told["s/cut/timeout/all/wait"]
        assert cut.interrupted
        assert cut.elapsed_s == pytest.approx(0.2 if stands_in else 0.5)
    for path, state in standing(resumed).items():
        assert replace(state, elapsed_s=None) == replace(told[path], elapsed_s=None), path
        since = (state.elapsed_s or 0.0) - (told[path].elapsed_s or 0.0)
        assert since == 0.0 or (state.status == "RUNNING" and since == pytest.approx(1 / 30, abs=1e-5)), path


def test_a_timeout_goes_on_counting() -> None:
    """The time before the stop counts: a limit is not prolonged by saving."""
    spec = parse_tree("tree: t\nroot:\n  timeout: 2\n  child: {wait: 9}\n", "t.yaml")
    _, _, saved, _ = play(spec, after(45))
    outcome, *_ = play(spec, saved=saved)
    assert outcome.failure is not None
    assert (outcome.failure.reason, round(outcome.time_s, 6)) == ("timeout", 2.0)


def test_a_state_of_another_tree_is_refused() -> None:
    """A node that the tree does not have is named with the nearest one."""
    spec = parse_tree(LONG, "t.yaml", SKILLS)
    _, _, saved, _ = play(spec, after(10))
    other = parse_tree(LONG.replace("sequence: day", "sequence: dax"), "t.yaml", SKILLS)
    with pytest.raises(UserError, match=r"another tree.*Nearest: 'dax"):
        play(other, saved=saved)


def test_a_broken_state_is_refused() -> None:
    """State that a node cannot use is an error that names the node."""
    spec = parse_tree("tree: t\nroot:\n  timeout: 2\n  child: {wait: 9}\n", "t.yaml")
    _, _, saved, _ = play(spec, after(10))
    data = saved.model_dump(mode="json")
    data["tree"]["nodes"]["timeout"]["state"]["elapsed_s"] = "long"
    with pytest.raises(UserError, match="timeout: its saved state"):
        play(spec, saved=SavedRun.model_validate(data))


GO = NodeSpec("navigate", NavigateTo(target="sink"))
TRIP = """\
tree: t
root:
  sequence: trip
  memory: true
  children:
    - {wait: 3 steps}
    - {navigate: cup}
    - {say: there}
    - {say: done}
"""


def bench(text: str) -> tuple[Tree, KinematicWorld]:
    """A tree that is set up."""
    world = KinematicWorld()
    tree = Tree(parse_tree(text, "t.yaml", SKILLS))
    tree.setup(scripted_context(world, SKILLS, PLACES, ANSWERS))
    return tree, world


def run(tree: Tree, world: KinematicWorld, ticks: int = 3000) -> Status:
    """Tick and step until the root ends, or so often."""
    for _ in range(ticks):
        if tree.tick() != Status.RUNNING:
            break
        world.step()
    return tree.status


@pytest.mark.parametrize("path", ["trip/wait", "trip/navigate", "trip/say"])
@pytest.mark.parametrize("ticks", [0, 1, 10])
def test_a_subtree_is_swapped_between_ticks(path: str, ticks: int) -> None:
    """What stood there is interrupted, the robot rests, and a sequence goes on where it was."""
    tree, world = bench(TRIP)
    run(tree, world, ticks)
    old, before = tree.nodes[path], tree.statuses()
    index = list(tree.nodes).index(path)
    tree.swap(path, GO)
    assert old.status == Status.INVALID
    assert [n.spec.kind for n in tree.spec.nodes][index] == "navigate"
    assert [s for i, s in enumerate(tree.statuses()) if i != index] == [s for i, s in enumerate(before) if i != index]
    farthest = 0.0
    while tree.tick() == Status.RUNNING and tree.ticks < 3000:
        world.step()
        farthest = max(farthest, float(world.robot.proprioception().base_pose[1]))
    assert tree.status == Status.SUCCESS
    behind = before[index] == Status.SUCCESS  # the cursor has passed it
    assert behind == (path == "trip/wait" and ticks == 10)
    assert list(tree.nodes.values())[index].status == (Status.INVALID if behind else Status.SUCCESS)
    assert (abs(farthest - 2.0) < 0.05) != behind  # only the new node drives there


def test_the_rest_of_a_sequence_is_swapped() -> None:
    """A new plan takes the place of the running unit and of all that were to come."""
    tree, world = bench(TRIP)
    run(tree, world, 10)
    tree.swap_rest("trip/navigate", [GO, GO])
    assert [n.path for n in tree.spec.nodes] == ["trip", "trip/wait", "trip/navigate", "trip/navigate#2"]
    assert list(tree.nodes) == [n.path for n in tree.spec.nodes]
    assert run(tree, world) == Status.SUCCESS
    assert tree.nodes["trip/navigate#2"].status == Status.SUCCESS


def test_the_root_and_an_only_child_are_swapped() -> None:
    """Any node can be swapped; only rows of siblings have a rest."""
    tree, world = bench("tree: t\nroot:\n  timeout: 9\n  child: {wait: 5}\n")
    run(tree, world, 3)
    tree.swap("timeout/wait", GO)
    assert run(tree, world, 2) == Status.RUNNING
    tree.swap("timeout", GO)
    assert list(tree.nodes) == ["navigate"]
    assert run(tree, world) == Status.SUCCESS
    with pytest.raises(UserError, match="swap it alone"):
        tree.swap_rest("navigate", [GO])
    with pytest.raises(UnknownName, match="Did you mean 'navigate'"):
        tree.swap("navigat", GO)


def test_a_node_that_cannot_be_set_up_is_not_swapped_in() -> None:
    """An unknown skill in the new part leaves the tree as it was."""
    tree, world = bench(TRIP)
    run(tree, world, 10)
    before = tree.spec, tree.statuses()
    new = parse_tree("tree: t\nroot:\n  check_complete: x\n  skill: pik\n", "t.yaml").root
    with pytest.raises(UnknownName, match="pick"):
        tree.swap("trip/navigate", new)
    assert (tree.spec, tree.statuses()) == before


def test_what_until_complete_waits_for_can_be_swapped() -> None:
    """A new last child ends the group."""
    tree, world = bench(
        "tree: t\nroot:\n  until_complete:\n  children:\n    - {manipulate: pick up the cup}\n    - {wait: 900}\n"
    )
    run(tree, world, 3)
    tree.swap("until_complete/wait", NodeSpec("navigate", NavigateTo(target="cup")))
    assert run(tree, world) == Status.SUCCESS


@pytest.mark.parametrize(
    ("new", "rest", "said"),
    [
        (
            "tree: n\nparameters: {x: number}\nroot:\n  timeout: $x\n  child: {say: hi}\n",
            False,
            "without a value: limit",
        ),
        ("tree: n\nroot: {say: hi}\n", True, "'until_complete' needs 2 children"),
        ("tree: n\nroot: " + "{attempt: , child: " * 89 + "{say: hi}" + "}" * 89, False, "one below the other"),
    ],
)
def test_what_could_not_be_read_from_a_file_is_not_swapped_in(new: str, rest: bool, said: str) -> None:
    """Stand-ins for parameters, too few children, too deep: refused, and the tree stays as it was."""
    tree, world = bench(
        "tree: t\nroot:\n  until_complete:\n  children:\n    - {manipulate: pick up the cup}\n    - {wait: 900}\n"
    )
    run(tree, world, 3)
    before = tree.spec, tree.statuses()
    node = parse_tree(new, "n.yaml").root
    swap = partial(tree.swap_rest, new=[node]) if rest else partial(tree.swap, new=node)
    with pytest.raises(UserError, match=said):
        swap("until_complete/manipulate")
    assert (tree.spec, tree.statuses()) == before


def test_states_tell_what_was_until_the_next_tick_tells_what_is() -> None:
    """An interrupted tree goes on telling where it ended; ticked again, it begins anew and says so."""
    tree, world = bench(TRIP)
    run(tree, world, 10)
    before = tree.states()
    assert before["trip/navigate"].status == "RUNNING"
    tree.interrupt()
    assert tree.states() == before
    tree.tick()
    now = tree.states()
    assert (now["trip/wait"].status, now["trip/navigate"].status) == ("RUNNING", "INVALID")


def test_states_are_those_of_the_new_tree_also_after_an_interruption() -> None:
    """What was drawn before the swap is not drawn any more."""
    tree, world = bench(TRIP)
    run(tree, world, 10)
    tree.interrupt()
    tree.swap("trip/navigate", NodeSpec("say", SaidText(text="hi"), ""))
    assert list(tree.states()) == list(tree.nodes)
