"""BDDL problems."""

import contextlib
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt import paths
from mpvi_bt.errors import UnknownName, UserError
from mpvi_bt.goals.evaluate import snapshot
from mpvi_bt.goals.formula import All, Formula, Literal
from mpvi_bt.goals.problem import Problem, load_problem, parse_problem
from mpvi_bt.suite.checking import below, problems_in
from mpvi_bt.suite.human import human_stats

TINY = """
(define (problem tiny) ; a comment with ( in it
    (:domain omnigibson)
    (:objects
        cup.n.01_1 cup.n.01_2 - cup.n.01
        shelf.n.01_1 shelf.n.01_* - shelf.n.01
        floor.n.01_1 - floor.n.01
        agent.n.01_1 - agent.n.01
    )
    (:init
        (ontop cup.n.01_1 floor.n.01_1)
        (not (open shelf.n.01_1))
        (future cup.n.01_2)
        (inroom floor.n.01_1 kitchen)
        (inroom shelf.n.01_1 kitchen)
        (inroom shelf.n.01_* kitchen)
        (ontop agent.n.01_1 floor.n.01_1)
    )\\
    (:goal %s)
)
"""


def tiny(goal: str = "(inside cup.n.01_1 shelf.n.01_1)") -> Problem:
    """A problem with that goal."""
    return parse_problem(TINY % goal, "tiny")


@pytest.mark.parametrize("activity", sorted(human_stats()))
def test_every_challenge_task_parses(activity: str) -> None:
    """All of the fifty problems parse, and their goals ground to literals over declared objects."""
    problem = load_problem(activity)
    literals = snapshot(problem, lambda _: False)
    assert literals
    assert all(arg in problem.objects for literal in literals for arg in literal.args)
    assert problem.movables
    assert problem.agent_room in problem.rooms.values()


def test_reading_problems_never_imports_bddl() -> None:
    """The package is slow to import and scores wrongly, so only its data files are read."""
    code = "import sys; from mpvi_bt.goals.problem import load_problem as l; l('picking_up_trash'); print(*sys.modules)"
    modules = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "mpvi_bt.goals.problem" in modules
    assert not {m for m in modules if m.split(".")[0] == "bddl"}


def test_picking_up_trash_is_what_it_says() -> None:
    """Three cans in the living room, a bin in the kitchen where the robot starts."""
    problem = load_problem("picking_up_trash")
    assert problem.movables == ("ashcan.n.01_1", *(f"can__of__soda.n.01_{i}" for i in (1, 2, 3)))
    assert problem.rooms == {"floor.n.01_2": "kitchen", "floor.n.01_1": "living_room"}
    assert problem.agent_room == "kitchen"


# Facts of BEHAVIOR 3.7's goals: literals, and how many of them hold at the start.
RESTATED = {
    "cook_hot_dogs": ({"cooked(hotdog.n.02_1)", "cooked(hotdog.n.02_2)"}, 0),
    "sorting_household_items": (
        {
            "under(bottle__of__detergent.n.01_1, sink.n.01_1)",
            "under(bottle__of__detergent.n.01_2, sink.n.01_1)",
            "nextto(bottle__of__detergent.n.01_1, bottle__of__detergent.n.01_2)",
            "ontop(box__of__sanitary_napkin.n.01_1, shelf.n.01_1)",
            "ontop(soap_dispenser.n.01_1, sink.n.01_1)",
            "ontop(cup.n.01_1, sink.n.01_1)",
            "nextto(tube__of__toothpaste.n.01_1, cup.n.01_1)",
            "inside(toothbrush.n.01_1, cup.n.01_1)",
        },
        1,
    ),
}


@pytest.mark.parametrize("activity", RESTATED)
def test_what_changed_since_the_distribution_is_restated(activity: str) -> None:
    """Two problems are those of the challenge, not of the older distribution: all of their literals must hold."""
    problem, (facts, held) = load_problem(activity), RESTATED[activity]
    assert {str(literal) for literal in snapshot(problem, lambda _: False)} == facts
    assert all(isinstance(literal, Literal) for literal in flat_conditions(problem.conditions))
    stated = {str(fact.literal) for fact in problem.init if fact.positive}
    assert len(facts & stated) == held
    assert problem.rooms.keys() | set(problem.movables) | {"agent.n.01_1"} == problem.objects.keys()


def flat_conditions(parts: Iterable[Formula]) -> Iterator[Formula]:
    """Parts of `and` and `forall` one by one."""
    for part in parts:
        if isinstance(part, All):
            yield from flat_conditions(part.children)
        else:
            yield part


def test_only_what_changed_is_restated() -> None:
    """Everything else is read from the distribution, so that its goals are BEHAVIOR's own."""
    assert {file.stem for file in (paths.shipped() / "tasks" / "problems").iterdir()} == RESTATED.keys()


def test_a_users_own_problem_is_found_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file in a root of MPVI_PATH makes an activity known, or takes the place of one."""
    folder = tmp_path / "tasks" / "problems"
    folder.mkdir(parents=True)
    for name in ("watering_plants", "cook_hot_dogs"):
        (folder / f"{name}.bddl").write_text(TINY % "(open shelf.n.01_1)")
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    for name in ("watering_plants", "cook_hot_dogs"):
        assert load_problem(name).conditions == (Literal("open", ("shelf.n.01_1",)),)
    assert load_problem("picking_up_trash").movables


def test_init_tells_fixtures_movables_and_what_comes_later_apart() -> None:
    """Fixtures have a room, the robot and future things are no movables."""
    problem = tiny()
    assert problem.movables == ("cup.n.01_1",)
    assert problem.future == {"cup.n.01_2"}
    assert [f.positive for f in problem.init if f.literal.predicate == "open"] == [False]


@pytest.mark.parametrize(("count", "shelves"), [(None, 1), (0, 1), (1, 1), (4, 4)])
def test_wildcards_grow_to_the_count_of_the_room(count: int | None, shelves: int) -> None:
    """A wildcard stands for every further fixture of its room; named ones never vanish."""
    problem = tiny("(forall (?s - shelf.n.01) (not (open ?s)))")
    assert problem.wildcards == {"shelf.n.01": "kitchen"}
    expanded = problem.expanded({} if count is None else {"shelf.n.01": count})
    assert not expanded.wildcards
    named = {f"shelf.n.01_{i + 1}" for i in range(shelves)}
    assert {name for name, kind in expanded.objects.items() if kind == "shelf.n.01"} == named
    assert {name for name, room in expanded.rooms.items() if room == "kitchen"} == named | {"floor.n.01_1"}
    assert set(snapshot(expanded, lambda _: False)) == {Literal("open", (name,)) for name in named}


def test_what_stands_beside_the_goals_and_is_dropped() -> None:
    """Upstream reads only the goal's first formula, and scores must agree with it (loading_the_car)."""
    problem = tiny("(and (inside cup.n.01_1 shelf.n.01_1)) (not (open shelf.n.01_1))")
    assert problem.conditions == (Literal("inside", ("cup.n.01_1", "shelf.n.01_1")),)
    assert all(literal.predicate == "inside" for literal in snapshot(load_problem("loading_the_car"), lambda _: False))


@pytest.mark.parametrize(
    ("goal", "words"),
    [
        ("(inside cup.n.01_1 shelf.n.01_7)", "unknown object 'shelf.n.01_7'. Did you mean 'shelf.n.01_1'?"),
        ("(exists (?c - cpu.n.01) (open ?c))", "unknown synset 'cpu.n.01'. Did you mean 'cup.n.01'?"),
        ("(exists (?c cup.n.01) (open ?c))", "is no (?variable - synset)"),
        ("(forn (x) (?c - cup.n.01) (open ?c))", "'x' in :goal is no whole number"),
        ("(not)", "is no formula"),
        ("", "has no :goal formula"),
        ("(open cup.n.01_1", "'(' without ')'"),
        ("(open cup.n.01_1)))))", "')' closes nothing"),
        ("(" * 60 + ")" * 60, "nest deeper than 50"),
    ],
)
def test_what_is_wrong_is_said(goal: str, words: str) -> None:
    """A malformed problem is a one-line user error that names it."""
    with pytest.raises(UserError) as caught:
        tiny(goal)
    assert words in str(caught.value)
    assert "tiny" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_start_names_declared_objects_only() -> None:
    """A misspelled object of :init is told at once, not when a start state is sought."""
    with pytest.raises(UserError, match=r"tiny: :init: unknown object 'cup.n.01_3'. Did you mean 'cup.n.01_[12]'"):
        parse_problem((TINY % "(open shelf.n.01_1)").replace("ontop cup.n.01_1", "ontop cup.n.01_3"), "tiny")


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        (TINY % "(open shelf.n.01_7)", 0, "unknown object 'shelf.n.01_7'"),
        ("(define\n(:objects)))", 2, "')' closes nothing"),
    ],
)
def test_check_tells_what_is_wrong_with_a_problem(tmp_path: Path, text: str, line: int, words: str) -> None:
    """`mpvi check` reads .bddl files, those below a folder too."""
    path = tmp_path / "mine.bddl"
    path.write_text(text)
    assert below(str(tmp_path)) == [str(path)]
    (problem,) = problems_in(str(path))
    assert (problem.file, problem.line, problem.code) == (str(path), line, "invalid-value")
    assert words in problem.message


def test_unknown_activity_names_the_nearest() -> None:
    """A misspelled activity is answered with the one that was meant."""
    with pytest.raises(UnknownName, match="Did you mean 'picking_up_trash'"):
        load_problem("picking_up_thrash")


@given(st.text(alphabet="() \n:-?;a1*_.\\", max_size=60))
def test_any_text_parses_or_is_a_user_error(text: str) -> None:
    """No text brings the parser down."""
    for source in (text, f"(define (:objects a_1 - a) (:init {text}) (:goal {text}))"):
        with contextlib.suppress(UserError):
            parse_problem(source, "fuzz")
