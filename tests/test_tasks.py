"""Tasks and suites on file."""

from __future__ import annotations

from pathlib import Path

import pytest

from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems, UnknownName, UserError
from mpvi_bt.house.goals.problem import activities, load_problem
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.runs.suite.suites import load_suite

TASK = """\
instruction: Put the cans in the bin.
problem: picking_up_trash
house: family_house
bindings:
  can__of__soda.n.01: can_of_soda
  ashcan.n.01: trash_can
plan: picking_up_trash
tree: picking_up_trash
"""


@pytest.mark.parametrize("name", paths.names("tasks"))
def test_every_shipped_task_loads_and_is_bound(name: str) -> None:
    """Each movable of its problem has a catalogue entry, and its budget is positive."""
    task = load_task(name)
    problem = load_problem(task.problem)
    assert {problem.objects[o] for o in problem.bound} == set(task.bindings)
    assert task.budget_s > 0


@pytest.mark.parametrize("name", paths.names("tasks/suites"))
def test_every_shipped_suite_names_each_episode_once(name: str) -> None:
    """Result files would overwrite one another otherwise."""
    names = [(config.method, config.name) for config in load_suite(name).episodes()]
    assert names
    assert len(set(names)) == len(names)


def test_the_budget_is_twice_the_human_time_unless_given(tmp_path: Path) -> None:
    """10535 steps for picking_up_trash, as in the 2025 challenge."""
    assert load_task("picking_up_trash").budget_s == pytest.approx(10535 / 30)
    path = tmp_path / "mine.yaml"
    path.write_text(TASK + "time_budget_s: 60\n")
    assert load_task(str(path)).budget_s == 60


@pytest.mark.parametrize(
    ("old", "new", "place", "words"),
    [
        ("problem: picking_up_trash", "problem: picking_up_thrash", "2:10", "Did you mean 'picking_up_trash'?"),
        ("family_house", "familly_house", "3:8", "unknown house 'familly_house'. Did you mean 'family_house'?"),
        ("can__of__soda.n.01:", "can_of_soda.n.01:", "5:3", "Did you mean 'can__of__soda.n.01'?"),
        ("  ashcan.n.01: trash_can\n", "", "4:1", "no binding for ashcan.n.01"),
        ("plan:", "plann:", "7:1", "unknown key 'plann'. Did you mean 'plan'?"),
        (": trash_can", ": trash_cn", "6:16", "unknown catalogue entry 'trash_cn'. Did you mean 'trash_can'?"),
        (": trash_can", ": can_of_soda", "6:16", "can_of_soda is can__of__soda.n.01, not ashcan.n.01"),
        ("plan: picking_up_trash", "plan: picking", "7:7", "unknown plan 'picking'"),
        ("tree: picking_up_trash", "tree: picking", "8:7", "unknown tree 'picking'"),
        ("tree: picking_up_trash\n", "tree: ../etc\n", "8:7", "should match the pattern"),
        ("tree: picking_up_trash\n", "tree: picking_up_trash\ninstances: 0\n", "9:12", "greater than or equal to 1"),
        ("tree: picking_up_trash\n", "tree: picking_up_trash\ntime_budget_s: .inf\n", "9:16", "finite"),
    ],
)
def test_what_is_wrong_with_a_task_is_placed(tmp_path: Path, old: str, new: str, place: str, words: str) -> None:
    """Line, column, and what would be valid."""
    path = tmp_path / "mine.yaml"
    assert old in TASK
    path.write_text(TASK.replace(old, new, 1))
    with pytest.raises(FileProblems) as caught:
        load_task(str(path))
    assert f"{path}:{place}: " in str(caught.value)
    assert words in str(caught.value)


def test_what_is_wrong_with_a_tasks_own_problem_is_said_of_the_problem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A floor that :init puts in no room is told there, not as a binding that the task lacks."""
    (tmp_path / "tasks" / "problems").mkdir(parents=True)
    text = activities()["picking_up_trash"].read_text()
    lines = [line for line in text.splitlines() if "inroom floor.n.01_1" not in line]
    file = tmp_path / "tasks" / "problems" / "mine.bddl"
    file.write_text("\n".join(lines))
    (tmp_path / "tasks" / "mine.yaml").write_text(
        TASK.replace("problem: picking_up_trash", "problem: mine\ntime_budget_s: 60")
    )
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    with pytest.raises(FileProblems) as caught:
        load_task("mine")
    assert [(p.code, p.file) for p in caught.value.problems] == [("missing-room", str(file))]
    file.write_text(text)
    assert load_task("mine").budget_s == 60


@pytest.mark.parametrize(
    ("goal", "words"),
    [
        ("(real half__log.n.01_1)", "no rule makes real(half__log.n.01_1): of the things come no others"),
        ("(contains ashcan.n.01_1 half__log.n.01_1)", "none of the things becomes half__log.n.01"),
    ],
)
def test_what_nothing_makes_is_told_by_check(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, goal: str, words: str
) -> None:
    """A goal for what does not exist yet is told of where none of the bound things may become it."""
    (tmp_path / "tasks" / "problems").mkdir(parents=True)
    text = activities()["picking_up_trash"].read_text()
    text = text.replace("(:objects", "(:objects\n half__log.n.01_1 - half__log.n.01")
    text = text.replace("(:init", "(:init\n (future half__log.n.01_1)")
    text = text.replace("(inside ?can__of__soda.n.01 ?ashcan.n.01_1)", goal)
    (tmp_path / "tasks" / "problems" / "mine.bddl").write_text(text)
    task = TASK.replace("problem: picking_up_trash", "problem: mine\ntime_budget_s: 60")
    (tmp_path / "tasks" / "mine.yaml").write_text(task)
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    with pytest.raises(FileProblems) as caught:
        load_task("mine")
    assert [words in problem.message for problem in caught.value.problems] == [True], caught.value


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("living_room", "sauna", "no start can be drawn: unknown room 'sauna'"),
        ("(ontop can__of__soda.n.01_1", "(attached can__of__soda.n.01_1", "cannot be sampled yet; known: ontop"),
        (
            "(inside ?can__of__soda.n.01 ?ashcan.n.01_1)",
            "(draped ?can__of__soda.n.01 ?ashcan.n.01_1)",
            "the goal cannot be judged",
        ),
        (
            "(inside ?can__of__soda.n.01 ?ashcan.n.01_1)",
            "(frozen ?can__of__soda.n.01)",
            "no rule makes frozen(can__of__soda.n.01_1): 'can_of_soda' says nothing of heat",
        ),
        (
            "(inside ?can__of__soda.n.01 ?ashcan.n.01_1)",
            "(cooked ?can__of__soda.n.01)",
            "no rule makes cooked(can__of__soda.n.01_1): 'can_of_soda' says nothing of heat",
        ),
    ],
)
def test_what_cannot_be_played_is_told_by_check(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, old: str, new: str, words: str
) -> None:
    """A room that the house lacks, a start or a goal that is not simulated: BEHAVIOR has them, a run would fail."""
    (tmp_path / "tasks" / "problems").mkdir(parents=True)
    text = activities()["picking_up_trash"].read_text()
    assert old in text
    (tmp_path / "tasks" / "problems" / "mine.bddl").write_text(text.replace(old, new))
    task = TASK.replace("problem: picking_up_trash", "problem: mine\ntime_budget_s: 60")
    (tmp_path / "tasks" / "mine.yaml").write_text(task)
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    with pytest.raises(FileProblems) as caught:
        load_task("mine")
    (problem,) = caught.value.problems
    assert (problem.code, problem.line) == ("unplayable", 2)
    assert words in problem.message


def test_unknown_tasks_and_suites_name_the_nearest() -> None:
    """A misspelled name is answered with the one that was meant."""
    with pytest.raises(UnknownName, match=r"unknown task 'picking_up_trsh'.*'picking_up_trash'"):
        load_task("picking_up_trsh")
    with pytest.raises(UnknownName, match=r"unknown suite 'trash100'.*'trash10'"):
        load_suite("trash100")


@pytest.mark.parametrize("instance", [-1, 10, 300])
def test_an_instance_out_of_range_says_the_range(instance: int) -> None:
    """The error tells which instances there are."""
    with pytest.raises(UserError, match=f"instance {instance} is out of range: the task has instances 0 to 9"):
        load_task("picking_up_trash").check_instance(instance)


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        ("tasks: [nonsense]\ninstances: [0]\n", "1:9", "unknown task 'nonsense'"),
        ("tasks: [picking_up_trash]\ninstances: [0, 10]\n", "2:16", "instance 10 is out of range"),
        ("tasks: [picking_up_trash]\ninstances: [1, 2, 1]\n", "2:19", "1 is in instances twice"),
        ("tasks: [picking_up_trash]\ninstances: []\n", "2:12", "1 item or more"),
        ("tasks: [picking_up_trash]\ninstances: [0, true]\n", "2:16", "should be a whole number, not true"),
        ("tasks: [picking_up_trash]\n", "1:1", "missing key 'instances'"),
    ],
)
def test_what_is_wrong_with_a_suite_is_placed(tmp_path: Path, text: str, place: str, words: str) -> None:
    """Line, column, and what is wrong."""
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(FileProblems) as caught:
        load_suite(str(path))
    assert f"{path}:{place}: " in str(caught.value)
    assert words in str(caught.value)


def test_a_suite_is_the_product_of_its_lists(tmp_path: Path) -> None:
    """Every task with every seed and instance, under the options given."""
    path = tmp_path / "mine.yaml"
    path.write_text("tasks: [picking_up_trash]\ninstances: [4, 2]\nseeds: [0, 1]\n")
    episodes = load_suite(str(path)).episodes(checker="oracle")
    assert [(c.seed, c.instance) for c in episodes] == [(0, 4), (0, 2), (1, 4), (1, 2)]
    assert {c.checker for c in episodes} == {"oracle"}
