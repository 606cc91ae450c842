"""The dry run: every tree without robot or simulator, fast, repeatable, and honest about what is not there."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from mpvi_bt.executive.behaviors.registry import node_types
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.ticking.dry import EmptyWorld, dry_tree, run_dry
from mpvi_bt.executive.trace.read import read_trace
from mpvi_bt.executive.tree.substitute import load_rules
from mpvi_bt.executive.tree.yaml_io import load_tree, parse_tree
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import NodeError
from mpvi_bt.runs.recording.recorder import Recorder
from tests.conftest import Shell

SKILLS = load_skills()
WORDS = {"text": "cup", "number": "5", "integer": "2", "boolean": "true"}


def shipped(name: str) -> Any:
    """A tree that comes with mpvi_bt, some value in each parameter that needs one."""
    path = paths.find("trees", name)
    spec = load_tree(path, SKILLS)
    return load_tree(
        path, SKILLS, {key: "pick" if key == "skill" else WORDS[spec.parameters[key].type] for key in spec.unbound}
    )


@pytest.mark.parametrize("name", paths.names("trees"))
def test_every_shipped_tree_ends(name: str) -> None:
    """In success: nothing in it needs a robot to go on, and nothing runs forever."""
    assert run_dry(dry_tree(shipped(name)), SKILLS).ending == "success"


@pytest.mark.parametrize("kind", [kind for kind, node in node_types().items() if node.robot])
def test_every_node_that_needs_a_robot_has_a_stand_in(kind: str) -> None:
    """No backend is asked for anything; all but a policy succeed, as they do in good runs."""
    headline = {"posture": "travel", "look_around": "90", "back_off": "2"}.get(kind, "the cup")
    tree = dry_tree(parse_tree(f"tree: t\nroot:\n  {kind}: {headline}\n"))
    assert run_dry(tree, max_time_s=10.0).ending == ("time_limit" if kind == "manipulate" else "success")


def test_a_stand_in_misses_what_the_real_node_would_miss() -> None:
    """A target on the blackboard that nothing has set fails here as it does with a robot."""
    outcome = run_dry(dry_tree(parse_tree("tree: t\nroot:\n  navigate: $nowhere\n")))
    assert outcome.failure
    assert outcome.failure.reason == "no_value"
    assert "nowhere" in outcome.failure.evidence


def test_the_blackboard_begins_with_the_values_of_the_tree() -> None:
    """And a second run does not see what the first one left."""
    spec = parse_tree(
        "tree: t\nblackboard: {n: 1}\nroot:\n  sequence:\n  memory: true\n  children:\n"
        "    - test: n\n      equals: 1\n    - set: n\n      add: 1\n"
    )
    assert [run_dry(dry_tree(spec)).ending for _ in range(2)] == ["success", "success"]


def lasting(path: Path) -> list[dict[str, Any]]:
    """A trace without wall times."""
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    return [{k: v for k, v in line.items() if k not in ("wall_s", "started")} for line in lines]


def test_the_same_rules_give_the_same_trace(tmp_path: Path) -> None:
    """Line for line, but for wall times."""
    file = tmp_path / "rules.yaml"
    file.write_text(
        "substitute:\n  - nodes: '*/check_complete'\n    fail: not_seen\n    after: 7 steps\n    times: 2\n"
    )
    for name in "ab":
        tree = dry_tree(shipped("throw_away_cans"), load_rules(file))
        run_dry(tree, SKILLS, [Recorder(tmp_path / name, {}, 0)])
    assert lasting(tmp_path / "a") == lasting(tmp_path / "b")
    assert len(lasting(tmp_path / "a")) > 20


def test_an_exception_is_in_the_trace_with_its_node(tmp_path: Path) -> None:
    """The trace of a run that broke ends with the path of the node and what it said."""
    (tmp_path / "rules.yaml").write_text("substitute:\n  - nodes: '*/set'\n    raise: the driver went away\n")
    spec = parse_tree(
        "tree: t\nroot:\n  sequence:\n  memory: true\n  children:\n    - wait: 1\n    - set: n\n      add: 1\n"
    )
    tree = dry_tree(spec, load_rules(tmp_path / "rules.yaml"))
    with pytest.raises(NodeError):
        run_dry(tree, subscribers=[Recorder(tmp_path / "t.jsonl", {}, 0)])
    end = json.loads((tmp_path / "t.jsonl").read_text().splitlines()[-1])
    assert end["end"] == "error"
    assert end["error"]["path"] == "sequence/set"
    assert "the driver went away" in end["error"]["message"]


def test_what_needs_a_robot_without_saying_so_is_told() -> None:
    """A node type of another package that asks for a backend though it is not marked: the error says what to do."""
    tree = dry_tree(parse_tree("tree: t\nroot:\n  wait: 1\n"))

    def update() -> Any:
        tree.context.navigator.start("cup", None)

    vars(tree.root)["update"] = update
    with pytest.raises(NodeError, match=r"a dry run has no navigator.*robot=True"):
        run_dry(tree)


def test_the_world_only_keeps_time() -> None:
    """Thirty steps a second, and it goes on from where it was saved."""
    world = EmptyWorld()
    for _ in range(45):
        world.step()
    again = EmptyWorld()
    again.restore(world.save())
    assert (world.steps, world.time_s) == (again.steps, again.time_s) == (45, 1.5)


def test_an_hour_passes_quickly() -> None:
    """Nothing sleeps: an hour of simulated time takes a small part of a minute."""
    outcome = run_dry(dry_tree(parse_tree("tree: t\nroot:\n  wait: 3600\n")), max_time_s=7200.0)
    assert (outcome.ending, outcome.steps) == ("success", 108_000)
    assert outcome.wall_s["total"] < 30.0


BLOCKED = """
import sys
class No:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {"sapien", "torch", "mani_skill", "cv2", "imageio_ffmpeg"}:
            raise ImportError(name + " is blocked")
sys.meta_path.insert(0, No())
from mpvi_bt.apps.cli import main
main()
"""


@pytest.mark.parametrize("words", [["--tree", "hello"], ["picking_up_trash"], ["--plan", "picking_up_trash"]])
def test_it_needs_neither_simulator_nor_pictures(words: list[str], tmp_path: Path) -> None:
    """With sapien, torch and OpenCV blocked a tree, a plan and a task run to their end."""
    command = [sys.executable, "-c", BLOCKED, "run", "--dry", *words]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "SUCCESS  dry run: " in done.stdout


def test_it_prints_the_tree_how_it_ended_and_writes_a_trace(mpvi: Shell, tmp_path: Path) -> None:
    """The tree, a line a change, the tree again, the score within 80 columns; the trace reads."""
    done = mpvi("run", "--dry", "--tree", "fetch", "--param", "object=cup")
    assert done.returncode == 0
    assert "Navigate(cup) [*]" in done.stdout
    assert done.stdout.endswith("SUCCESS  dry run: tree succeeded\n  time      8.0 s simulated, 241 ticks\n")
    assert max(map(len, done.stdout.splitlines())) <= 80
    assert done.stderr == ""
    trace = read_trace(tmp_path / "runs" / "fetch_dry.trace.jsonl")
    assert trace.end
    assert trace.end.ending == "success"
    assert trace.config == {"dry": True, "tree": "fetch", "arguments": {"object": "cup"}}


FAILING = "substitute:\n  - nodes: '*/check_complete'\n    fail: not_seen\n"


def test_a_tree_that_fails_ends_with_1_and_says_why(mpvi: Shell, tmp_path: Path) -> None:
    """The command that explains stands at the end, works, and names the rule."""
    (tmp_path / "rules.yaml").write_text(FAILING)
    done = mpvi("run", "--dry", "--tree", "pick_up", "--param", "object=cup", "--substitute", "rules.yaml")
    assert done.returncode == 1
    last = done.stdout.splitlines()[-1].split()
    assert last[:3] == ["why", "mpvi", "explain"]
    explained = mpvi(*last[2:])
    assert "not_seen: substituted by rules.yaml:2" in " ".join(explained.stdout.split())


def test_json_tells_the_same(mpvi: Shell, tmp_path: Path) -> None:
    """One object on stdout, the tree on stderr; without a trace none is written."""
    (tmp_path / "rules.yaml").write_text(FAILING)
    words = ["--tree", "pick_up", "--param", "object=cup", "--substitute", "rules.yaml", "--no-trace", "--json"]
    done = mpvi("run", "--dry", *words)
    told = json.loads(done.stdout)
    assert (told["success"], told["ended"], told["trace"]) == (False, "failure", None)
    (failure,) = told["failures"]
    assert (failure["reason"], failure["feedback"]) == ("not_seen", "substituted by rules.yaml:2")
    assert "Manipulate" in done.stderr
    assert not list(tmp_path.glob("runs/*"))


def test_a_node_that_breaks_ends_with_3(mpvi: Shell, tmp_path: Path) -> None:
    """Its path, what it said, and where to read on; no traceback."""
    (tmp_path / "rules.yaml").write_text("substitute:\n  - nodes: '*/say'\n    raise: the driver went away\n")
    done = mpvi("run", "--dry", "--tree", "hello", "--no-watch", "--substitute", "rules.yaml")
    assert done.returncode == 3
    assert done.stderr == "mpvi: say: Substituted: the driver went away (substituted by rules.yaml:2)\n"
    assert done.stdout.startswith("ERROR  dry run\n")
    assert done.stdout.endswith("  why       mpvi explain runs/hello_dry.trace.jsonl\n")
    done = mpvi("run", "--dry", "--tree", "hello", "--no-watch", "--substitute", "rules.yaml", "--json")
    told = json.loads(done.stdout)
    assert (done.returncode, told["ended"], told["success"]) == (3, "error", False)
    assert told["error"] == {
        "node": "say",
        "message": "Substituted: the driver went away (substituted by rules.yaml:2)",
        "place": "",
    }


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "nothing to run"),
        (["--tree", "helo"], "Did you mean 'hello'"),
        (["--tree", "hello", "--instance", "3"], "--instance is one of a TASK"),
        (["picking_up_trash", "--instance", "99"], "instance 99 is out of range"),
        (["--tree", "hello", "--picture", "a.png"], "nothing to film, to draw, to log, to record or to time"),
        (["--tree", "hello", "--substitute", "no.yaml"], "no.yaml: no such file"),
        (
            ["--tree", "hello", "--break", "*/syy"],
            "--break: no node of tree 'hello' fits '*/syy'. Did you mean '*/say'",
        ),
        (["--tree", "pick_up"], "--param object=TEXT"),
        (["--tree", "pick_up", "--param", "object"], "--param wants NAME=VALUE, not 'object'"),
        (["--tree", "pick_up", "--param", "objct=cup"], "objct"),
        (["--tree", "pick_up", "--param", "object=cup", "--param", "object=x"], "object is given twice"),
        (["--tree", "pick_up", "--param", "object=cup", "--param", "seconds=soon"], "seconds"),
        (["--plan", "picking_up_trash", "--param", "a=b"], "only a tree of a file has parameters"),
    ],
)
def test_bad_input_is_one_clear_error(words: list[str], said: str, mpvi: Shell, tmp_path: Path) -> None:
    """Exit code 2, what would be valid, no traceback; nothing is left behind."""
    done = mpvi("run", "--dry", *words)
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


def test_a_dry_run_that_leaves_nothing_needs_no_folder(mpvi: Shell) -> None:
    """Without a trace it runs where nothing can be written."""
    words = ["run", "--dry", "--tree", "hello", "--out", "/proc/none"]
    assert mpvi(*words).returncode == 2
    assert mpvi(*words, "--no-trace").returncode == 0


def test_a_robot_node_of_another_package_has_a_stand_in_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """It need not be known here: a second passes, and it has succeeded."""
    ours = node_types()["navigate"]
    other = replace(ours, kind="dance", factory="another.package:Dance")
    monkeypatch.setattr(
        "mpvi_bt.executive.behaviors.registry.metadata.entry_points",
        lambda group: [SimpleNamespace(name="dance", value="another.package:ROW", load=lambda: other)],
    )
    node_types.cache_clear()
    try:
        outcome = run_dry(dry_tree(parse_tree("tree: t\nroot:\n  dance: waltz\n")))
    finally:
        node_types.cache_clear()
    assert (outcome.ending, outcome.steps) == ("success", 30)
