"""What is valid and can hardly be meant: found where it is, and nowhere else."""

from __future__ import annotations

from pathlib import Path

import pytest

from mpvi_bt.apps.authoring.checking import problems_in
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.ticking.dry import dry_tree, run_dry
from mpvi_bt.executive.tree import lint
from mpvi_bt.executive.tree.yaml_io import load_tree, parse_tree
from mpvi_bt.ground import paths
from mpvi_bt.ground.robot import protocol
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.runs.choices.planning import ground
from tests.test_check import GOOD, of, run

ROOT = paths.shipped()

LINTED = [
    ("navigate: $object", "navigate: $objekt", 14, "unwritten-key"),
    ("test: tries", "test: trys", 26, "unwritten-key"),
    ("sequence: t", "sequence: t $objekt", 7, "unknown-parameter"),
    ("blackboard:\n  tries: 0", "blackboard:\n  tries: 0\n  cups: 1", 6, "unread-key"),
    ("    - test: tries\n      at_least: 1", "    - succeed:", 16, "unread-key"),
    ("default: cup}", "default: cup}\n  other: text", 4, "unused-parameter"),
    ("    - set: tries", "    - fail:\n    - set: tries", 17, "unreachable"),
    ("    - test: tries", "    - selector:\n      memory: true\n      children:\n        - say: hi\n        - fail:\n"
     "    - test: tries", 30, "unreachable"),
    ("    - set: tries", "    - manipulate: pick up the cup\n    - set: tries", 16, "never-ends"),
    ("    - set: tries", "    - manipulate: pick up the cup\n    - set: tries", 17, "unreachable"),
    ("sequence: t\n  memory: true\n  children:", "sequence: t\n  memory: false\n  children:\n    - navigate: sofa", 8,
     "begun-anew"),
    ("sequence: t\n  memory: true\n  children:", "sequence: t\n  memory: false\n  children:\n    - repeat: 2\n"
     "      child: {wait: 1}", 8, "begun-anew"),
    ("timeout: 30", "timeout: 60", 20, "timeout-too-long"),
    ("timeout: 30", "timeout: 1801 steps", 20, "timeout-too-long"),
    ("pick up the $object", "pik up the cup", 24, "no-skill"),
    ("pick up the $object", "pick up the cup, then sing", 24, "no-skill"),
    ("            - check_complete: the $object is held", "            - look_around: 90\n"
     "            - check_complete: the $object is held", 25, "two-drivers"),
    ("navigate: $object\n          room: kitchen", "wait: 1", 12, "pointless-retry"),
    ("retry: 3\n        child:\n          navigate: $object\n          room: kitchen", "repeat: 3\n"
     "        child:\n          fail: $object", 12, "pointless-repeat"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "line", "code"), LINTED)
def test_what_can_hardly_be_meant_is_told(tmp_path: Path, old: str, new: str, line: int, code: str) -> None:
    """Each such thing is found on its line, where the good tree has nothing to find."""
    assert of(tmp_path, GOOD) == []
    assert GOOD.count(old) == 1
    assert (line, code) in [found[:2] for found in of(tmp_path, GOOD.replace(old, new))]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("timeout: 30", "timeout: 1799 steps"),
        ("timeout: 30", "timeout: 59.9"),
        ("add: 1", "value: $object"),
        ("sequence: t\n  memory: true", "sequence: t\n  memory: false"),
        ("    - set: tries", "    - attempt:\n      child:\n        timeout: 3\n        child:\n"
         "          manipulate: pick up the cup\n    - set: tries"),
        ("{type: text, default: cup}", "text"),
        ("manipulate: pick up the $object", "manipulate: $tries"),
        ("    - set: tries", "    - parallel:\n      policy: success_on_one\n      children:\n"
         "        - manipulate: pick up the cup\n        - wait: 3\n    - set: tries"),
        ("    - set: tries", "    - parallel:\n      policy: success_on_all\n      children:\n"
         "        - sequence:\n          memory: true\n          children: [{navigate: cup}, {posture: travel}]\n"
         "        - say: two in turn\n        - check_complete: held\n    - set: tries"),
        ("    - set: tries", "    - selector:\n      memory: false\n      children:\n        - test: tries\n"
         "        - succeed:\n    - set: tries"),
        ("    - set: tries", "    - repeat: 2\n      child:\n        say: ${tries} of $$3\n    - set: tries"),
    ],
)  # fmt: skip
def test_what_may_be_meant_is_left_alone(tmp_path: Path, old: str, new: str) -> None:
    """No warning where there is no fault."""
    assert GOOD.count(old) == 1
    assert of(tmp_path, GOOD.replace(old, new)) == []


def test_a_sequence_that_is_begun_anew_never_ends(tmp_path: Path) -> None:
    """What the warning says is so, and only of the trees that have it: half a minute of a dry run tells."""
    for first, second, warned in (
        ("navigate: kitchen", "navigate: sofa", True),
        ("wait: 1", "posture: travel", True),
        ("wait: 1", "say: that was a second", False),
        ("test: here", "navigate: sofa", False),
    ):
        spec = parse_tree(
            f"tree: t\nblackboard: {{here: true}}\nroot:\n  sequence:\n  memory: false\n  children: [{{{first}}}, "
            f"{{{second}}}]\n"
        )
        assert ("begun-anew" in [p.code for p in lint.lint(spec)]) is warned
        ending = run_dry(dry_tree(spec), max_time_s=30.0).ending
        assert ending == ("time_limit" if warned else "success"), (first, second)


def test_warnings_are_told_from_errors(tmp_path: Path) -> None:
    """A key that nothing writes fails the tree when it runs: an error; one that nothing reads is a warning."""
    found = of(tmp_path, GOOD.replace("test: tries", "test: trys"))
    assert found == [(16, "unread-key", "warning"), (26, "unwritten-key", "error")]
    assert ": warning: nothing reads" in run(tmp_path / "t.yaml")[1]


def test_a_timeout_in_another_file_is_told_where_it_is_called(tmp_path: Path) -> None:
    """The caller can mend it, so the problem stands at the call and names the other place."""
    (tmp_path / "slow.yaml").write_text("tree: slow\nroot:\n  timeout: 90\n  child:\n    navigate: cup\n")
    (tmp_path / "t.yaml").write_text("tree: t\nroot:\n  timeout: 60\n  child:\n    subtree: slow\n")
    (problem,) = problems_in(str(tmp_path / "t.yaml"))
    assert (problem.file, problem.line, problem.code) == (str(tmp_path / "t.yaml"), 5, "timeout-too-long")
    assert f"{tmp_path / 'slow.yaml'}:3:3" in problem.message


def test_what_a_subtree_reads_may_come_from_its_caller(tmp_path: Path) -> None:
    """A key that the caller writes and hands over by an argument is written; one that it misspells is told once."""
    (tmp_path / "go.yaml").write_text(
        "tree: go\nparameters: {to: text}\nroot:\n  sequence: go to the $to\n  memory: true\n"
        "  children:\n    - navigate: $to\n    - say: at the $to\n"
    )
    tree = "tree: t\nblackboard: {place: sofa}\nroot:\n  subtree: go\n  arguments: {to: $place}\n"
    (tmp_path / "t.yaml").write_text(tree)
    assert problems_in(str(tmp_path / "t.yaml")) == []
    (tmp_path / "t.yaml").write_text(tree.replace("$place", "$plaice"))
    found = [(Path(p.file).name, p.line, p.code) for p in problems_in(str(tmp_path / "t.yaml"))]
    assert found == [("t.yaml", 2, "unread-key"), ("t.yaml", 5, "unwritten-key")]


def test_a_subtree_does_not_have_its_callers_parameters(tmp_path: Path) -> None:
    """What it refers to, and gets neither by an argument nor from the blackboard, is told in its file."""
    (tmp_path / "inner.yaml").write_text("tree: inner\nparameters: {what: text}\nroot:\n  say: $what in the $room\n")
    outer = "tree: outer\nparameters: {room: text}\nroot:\n  subtree: inner\n  arguments: {what: cup}\n"
    (tmp_path / "outer.yaml").write_text(outer)
    found = problems_in(str(tmp_path / "outer.yaml"))
    assert ("inner.yaml", 4, "unwritten-key") in [(Path(p.file).name, p.line, p.code) for p in found]


def test_rooms_are_those_of_the_task(tmp_path: Path) -> None:
    """With --task a room that the house does not have is an error with the nearest one; however it is spelt."""
    path = tmp_path / "t.yaml"
    good = GOOD.replace("default: cup", "default: can of soda")
    path.write_text(good.replace("room: kitchen", "room: kitchn"))
    assert run(path) == (0, "")
    code, output = run(path, "--task", "picking_up_trash")
    assert code == 1
    assert f"{path}:15:17: unknown room 'kitchn'. Did you mean 'kitchen'?" in output
    path.write_text(good.replace("room: kitchen", "room: The Living_Room"))
    assert run(path, "--task", "picking_up_trash") == (0, "")


def test_targets_are_things_of_the_task(tmp_path: Path) -> None:
    """With --task a warning stands where nothing is called as what a node drives to; rooms and fixtures are things."""
    path = tmp_path / "t.yaml"
    path.write_text(GOOD.replace("default: cup", "default: can of sodda"))
    code, output = run(path, "--task", "picking_up_trash")
    assert code == 1
    assert f"{path}:14:21: warning: nothing there is called 'can of sodda'. Did you mean 'can of soda'?" in output
    for known in ("The Kitchen", "sofa", "trash can", "$tries"):
        path.write_text(GOOD.replace("navigate: $object", f"navigate: {known}"))
        assert run(path, "--task", "picking_up_trash") == (0, "")


def test_a_target_of_a_subtree_is_told_at_its_call(tmp_path: Path) -> None:
    """The caller can mend it, not the file that comes with mpvi_bt, which is named in the message."""
    path = tmp_path / "t.yaml"
    path.write_text("tree: t\nroot:\n  subtree: go_to\n  arguments: {place: kitchn}\n")
    found = problems_in(str(path), ground("family_house", load_task("picking_up_trash")))
    assert {(p.file, p.line, p.nearest) for p in found} == {(str(path), 4, "kitchen")}
    assert all(f"(at {ROOT / 'trees' / 'go_to.yaml'}:" in p.message for p in found)


def test_rooms_that_are_looked_up_later_are_left_alone() -> None:
    """A room from the blackboard is not known yet; a tree that was not read from a file has problems all the same."""
    spec = parse_tree("tree: t\nroot:\n  navigate: cup\n  room: $here\n")
    assert lint.check_rooms(spec, ["kitchen"]) == []
    spec = parse_tree("tree: t\nroot:\n  attempt:\n  child:\n    navigate: cup\n    room: cellar\n")
    (problem,) = lint.check_rooms(spec, ["living_room", "kitchen"])
    assert (problem.line, problem.known) == (5, ("kitchen", "living room"))


def test_the_control_rate_is_the_robots() -> None:
    """What compares steps with seconds does so at the rate of the loop."""
    assert lint.CONTROL_HZ == protocol.CONTROL_HZ


@pytest.mark.parametrize("path", sorted((ROOT / "trees").glob("*.yaml")), ids=lambda p: p.stem)
def test_shipped_trees_have_nothing_hard_to_mean(path: Path) -> None:
    """Also without the marks of their file, as when a tree is made in Python."""
    assert lint.lint(load_tree(path), load_skills()) == []
