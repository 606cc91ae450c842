"""`mpvi new`: what it writes passes `mpvi check` and runs, and nothing that is there is lost."""

from __future__ import annotations

import json
import runpy
from pathlib import Path

import numpy as np
import pytest

import mpvi_bt
from mpvi_bt.apps.authoring.part_skeletons import new_part
from mpvi_bt.apps.authoring.skeletons import new_house, new_object, new_skill, new_task, new_tree
from mpvi_bt.executive.plan.clauses import match
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.ground.errors import UserError
from mpvi_bt.house.things.catalogue import load_catalogue
from mpvi_bt.house.things.families import FAMILIES
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.testing import check_policy
from mpvi_bt.testing.doubles import KinematicRobot
from tests import warm
from tests.conftest import Shell
from tests.layouts import BASE

MAKERS = {
    "tree": new_tree,
    "skill": new_skill,
    "object": new_object,
    "house": new_house,
    "task": new_task,
}


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of one's own, which is found and is the current one."""
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("kind", MAKERS)
def test_what_is_written_passes_check(kind: str, root: Path) -> None:
    """Without a warning, too."""
    MAKERS[kind]("quite_new").write(root)
    assert mpvi_bt.check(root) == []


@pytest.mark.parametrize("like", sorted(load_skills()))
def test_a_skill_can_be_like_any(like: str, root: Path) -> None:
    """Its file is fine, and a sentence with its verb in the place of the other's names it, whose motion does it."""
    new_skill("juggle", like).write(root)
    assert mpvi_bt.check(root) == []
    skill = load_skills()["juggle"]
    assert skill.phrases[0].startswith("juggle")
    assert skill.like == like


def test_a_skill_like_another_is_done_as_that(root: Path) -> None:
    """With the words of its own sentence."""
    new_skill("stash", "place_in").write(root)
    call = match("stash the can in the trash can with the left hand", load_skills())
    assert call is not None
    assert (call.skill.name, call.motion, call.arguments["container"]) == ("stash", "place_in", "trash can")


@pytest.mark.parametrize(
    ("like", "phrase", "said"),
    [
        ("plase_in", "stash {object} in {container}", "unknown skill 'plase_in'. Did you mean 'place_in'?"),
        (
            "place_in",
            "stash {object} by {tool}",
            "unknown slot 'tool' of 'place_in'. Known: container, hand, object.",
        ),
    ],
)
def test_a_skill_is_like_none_that_there_is_not(like: str, phrase: str, said: str, root: Path) -> None:
    """Neither a motion that nobody has, nor words that the motion does not know."""
    path = root / "stash.yaml"
    path.write_text(
        f"name: stash\nabout: Put away.\nlike: {like}\nphrases: ['{phrase}']\n"
        "triggers: [{event: release, camera: head}]\ntimeout_s: 90\n"
    )
    assert [p.message for p in mpvi_bt.check(path)] == [said]


@pytest.mark.parametrize("family", sorted(set(FAMILIES) - {"mesh"}))
def test_an_object_can_have_any_family(family: str, root: Path) -> None:
    """As the first entry of that family has it."""
    new_object("quite_new", family).write(root)
    assert mpvi_bt.check(root) == []
    assert load_catalogue()["quite_new"].family == family


def test_an_object_is_filed_by_a_name_of_behavior() -> None:
    """One of its own name, the one that is asked for, or that of what it is like; never one that there is not."""
    assert "synset: vase.n.01" in "".join(new_object("vase", "bottle").files.values())
    assert "synset: toy_figure.n.01" in "".join(new_object("gnome", "bottle", "toy_figure.n.01").files.values())
    gnome = new_object("gnome", "bottle")
    assert "synset: bottle.n.01" in "".join(gnome.files.values())
    assert "--synset" in gnome.remarks[1]
    with pytest.raises(UserError, match=r"unknown synset 'toy_figur\.n\.01'\. Did you mean 'toy_figure\.n\.01'"):
        new_object("gnome", "bottle", "toy_figur.n.01")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("My Tree!", "'my_tree' would do"),
        ("fetchAndCarry", "'fetch_and_carry' would do"),
        ("2nd", "'my_2nd' would do"),
        ("class", "'my_class' would do"),
        ("../up", "'up' would do"),
        ("", "'my_tree' would do"),
        ("fetch", "'my_fetch' is free"),
    ],
)
def test_a_bad_name_is_refused_with_a_good_one(name: str, said: str, root: Path) -> None:
    """What cannot name a file, or would hide another."""
    with pytest.raises(UserError, match=said):
        new_tree(name)


def test_nothing_is_written_over(root: Path) -> None:
    """Nor is half of a task written where another part of it is there."""
    there = root / "tasks" / "problems" / "tidy.bddl"
    there.parent.mkdir(parents=True)
    skeleton = new_task("tidy")
    there.write_text("mine")
    with pytest.raises(UserError, match="is there already"):
        skeleton.write(root)
    assert there.read_text() == "mine"
    assert not (root / "tasks" / "tidy.yaml").exists()


def test_what_it_says_to_do_next_works(tmp_path: Path, mpvi: Shell) -> None:
    """Where the folder is not found yet, how it will be; then each command but those that take a simulator."""
    done = mpvi("new", "tree", "my_tree", "--json")
    told = json.loads(done.stdout)
    export, *commands = told["next"]
    assert export == f"export MPVI_PATH={tmp_path}"
    assert told["written"] == ["trees/my_tree.yaml"]
    for command in commands[:-1]:
        assert mpvi(*command.split()[1:], MPVI_PATH=str(tmp_path)).returncode == 0
    again = mpvi("new", "tree", "your_tree", MPVI_PATH=str(tmp_path), cwd=tmp_path.parent)
    assert again.stdout.splitlines()[0] == f"wrote {tmp_path.name}/trees/your_tree.yaml"
    assert "export" not in again.stdout
    refused = mpvi("new", "tree", "my_tree", MPVI_PATH=str(tmp_path))
    assert (refused.returncode, refused.stderr.count("\n")) == (2, 1)


def test_a_policy_keeps_the_contract(root: Path) -> None:
    """And can be chosen by the path that is told; one that would be hidden by an installed module is refused."""
    new_part("policy", "steady").write(root)
    made = runpy.run_path("steady.py")["Steady"]
    check_policy(made(seed=0), make=lambda: made(seed=0))
    robot = KinematicRobot()
    robot.act(robot.action + 0.3)
    seen = {"prompt": "wait", "proprioception": robot.proprioception(), "images": {}, "command": robot.action}
    still = robot.action
    still[BASE] = 0
    np.testing.assert_array_equal(made(seed=0).infer(seen), np.tile(still, (10, 1)))  # it stands still, as it says
    from mpvi_bt.runs.episode.prepare import check_backends

    check_backends(EpisodeConfig("picking_up_trash", policy="steady:Steady"))
    with pytest.raises(UserError, match="'my_json' is free"):
        new_part("policy", "json")


@pytest.mark.parametrize("kind", ["policy", "detector", "checker"])
def test_a_part_that_is_written_runs(kind: str, root: Path, mpvi: Shell) -> None:
    """By the first of the commands that are told, which checks its contract; and it can be chosen."""
    told = json.loads(mpvi("new", kind, f"my_{kind}", "--json", cwd=root).stdout)
    check, run = told["next"]
    done = warm.python(check.split()[1], cwd=root)
    assert done.stdout == f"keeps the contract of {'policies' if kind == 'policy' else kind + 's'}\n", done.stderr
    assert run in (root / f"my_{kind}.py").read_text()


def test_a_node_that_is_written_runs(root: Path, mpvi: Shell) -> None:
    """By the commands that are told, from any folder."""
    told = json.loads(mpvi("new", "node", "my_node", "--json", cwd=root).stdout)
    for command in told["next"]:
        done = mpvi(*command.split()[1:], cwd=root)
        assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
def test_a_navigator_that_is_written_drives(root: Path, mpvi: Shell) -> None:
    """By the command in its first lines, which plays an episode; here of a tree that does nothing else."""
    mpvi("new", "navigator", "my_navigator", cwd=root)
    (command,) = [line for line in (root / "my_navigator.py").read_text().splitlines() if line.startswith("mpvi ")]
    drive = ("--tree", "go_to", "--param", "place=can of soda")
    done = mpvi(*command.split()[1:], *drive, cwd=root, timeout=600)
    assert "goal not met; tree succeeded" in done.stdout, done.stdout + done.stderr
    result = next((root / "runs").glob("*_0.json")).read_text()
    assert "my_navigator:MyNavigator" in result
    assert json.loads(result)["agent_distance"]["base"] > 1


@pytest.mark.parametrize("kind", ["detector", "navigator", "checker"])
def test_the_docs_show_the_whole_class_that_is_written(kind: str) -> None:
    """So that what they show is what other tests run."""
    page = (Path(__file__).parent.parent / "docs" / "policies.md").read_text(encoding="utf-8")
    (written,) = new_part(kind, f"my_{kind}").files.values()
    assert f"```python\n{written}```" in page
