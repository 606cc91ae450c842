"""BDDL problems."""

import contextlib
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.apps.authoring.checking import below, problems_in
from mpvi_bt.apps.cli.check import check
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems, UnknownName, UserError
from mpvi_bt.ground.human import human_stats
from mpvi_bt.house.goals.evaluate import snapshot
from mpvi_bt.house.goals.findings import Findings
from mpvi_bt.house.goals.formula import All, Formula, Literal
from mpvi_bt.house.goals.problem import BddlProblem, activities, load_problem, parse_problem
from mpvi_bt.house.goals.vocabulary import behavior

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


def tiny(goal: str = "(inside cup.n.01_1 shelf.n.01_1)") -> BddlProblem:
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
    code = (
        "import sys; from mpvi_bt.house.goals.problem import load_problem as l; "
        "l('picking_up_trash'); print(*sys.modules)"
    )
    modules = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "mpvi_bt.house.goals.problem" in modules
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
    """A misspelled object of :init is told at once, not when a start state is sought; of its second argument, too."""
    for wrong in ("(ontop cup.n.01_3 floor.n.01_1)", "(ontop cup.n.01_1 flor.n.01_1)"):
        with pytest.raises(FileProblems, match=r"tiny:11:(16|27): unknown object '.*'\. Did you mean '(cup|floor)"):
            parse_problem((TINY % "(open shelf.n.01_1)").replace("(ontop cup.n.01_1 floor.n.01_1)", wrong), "tiny")


GOOD = """\
(define (problem tea-0)
  (:domain omnigibson)
  (:objects
    teacup.n.02_1 teacup.n.02_2 - teacup.n.02
    cabinet.n.01_1 - cabinet.n.01
    shelf.n.01_1 shelf.n.01_* - shelf.n.01
    floor.n.01_1 - floor.n.01
    agent.n.01_1 - agent.n.01)
  (:init
    (ontop teacup.n.02_1 floor.n.01_1)
    (inside teacup.n.02_2 cabinet.n.01_1)
    (not (open cabinet.n.01_1))
    (inroom cabinet.n.01_1 kitchen)
    (inroom shelf.n.01_1 kitchen)
    (inroom shelf.n.01_* kitchen)
    (inroom floor.n.01_1 kitchen)
    (ontop agent.n.01_1 floor.n.01_1))
  (:goal
    (and
      (forn (1) (?cup - teacup.n.02) (inside ?cup cabinet.n.01_1))
      (or (open cabinet.n.01_1) (not (ontop teacup.n.02_1 floor.n.01_1))))))
"""


def checked(folder: Path, text: str) -> list[str]:
    """What `mpvi check` says of a problem, without the name of its file: "4:5: message [code]"."""
    path = folder / "tea.bddl"
    path.write_text(text)
    assert below(str(folder)) == [str(path)]
    return [str(problem).removeprefix(f"{path}:") for problem in problems_in(str(path))]


def test_a_good_problem_of_ones_own_is_good(tmp_path: Path) -> None:
    """`mpvi check` reads .bddl files, those below a folder too, and finds nothing in one that is right."""
    assert checked(tmp_path, GOOD) == []
    assert checked(tmp_path, GOOD.replace("(and", "(AND").replace("(inroom", "(Inroom")) == []


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [  # the place is that of the word, the nearest name is given
        ("(inside teacup.n.02_2", "(insde teacup.n.02_2", "11:6: unknown predicate 'insde'. Did you mean 'inside'?"),
        ("(inside ?cup", "(insid ?cup", "20:39: unknown predicate 'insid'. Did you mean 'inside'?"),
        ("(not (open", "(no (open", "12:6: unknown predicate 'no'. Did you mean 'not'?"),
        ("(or (open", "(orr (open", "21:8: unknown predicate 'orr'. Did you mean 'or'?"),
        ("cabinet.n.01_1 kitchen", "cabinet.n.01_1 kichen", "13:28: unknown room 'kichen'. Did you mean 'kitchen'?"),
        ("- teacup.n.02\n", "- teacp.n.02\n", "4:35: unknown synset 'teacp.n.02'. Did you mean 'teacup.n.02'?"),
        ("- teacup.n.02)", "- teacu.n.02)", "20:25: unknown synset 'teacu.n.02'. Did you mean 'teacup.n.02'?"),
        ("- teacup.n.02)", "- bowl.n.01)", "20:25: no object is a bowl.n.01; :objects has agent.n.01, cabinet.n.01,"),
        ("(ontop agent.n.01_1 floor", "(ontop agent.n.01_1 flor", "17:25: unknown object 'flor.n.01_1'. Did you me"),
        ("(inside ?cup cab", "(inside ?cp cab", "20:46: unknown object 'cp'. Did you mean 'cup'?"),
        ("(inside ?cup cabinet.n.01_1)", "(inside ?cup)", "20:38: '(inside cup)': inside takes two objects"),
        ("(open cabinet.n.01_1) (", "(open) (", "21:11: '(open)' is no (predicate object ...)"),
        ("(not (open cabinet.n.01_1))", "(not (open cabinet.n.01_1 floor.n.01_1))", "12:10: '(open cabinet.n.01_1"),
        ("(inroom shelf.n.01_1 kitchen)", "(inroom shelf.n.01_1)", "14:5: '(inroom shelf.n.01_1)': inroom takes"),
        ("(inroom cabinet.n.01_1 kitchen)", "", "5:5: :init does not say in which room cabinet.n.01_1 is: (inroom cab"),
        ("(inroom shelf.n.01_* kitchen)", "", "6:18: :init does not say in which room shelf.n.01_* is"),
        ("(inroom floor.n.01_1 kitchen)", "", "7:5: :init does not say in which room floor.n.01_1 is"),
        ("(inside teacup.n.02_2 cabinet.n.01_1)", "", "4:19: :init does not say where teacup.n.02_2 is"),
        ("(ontop agent.n.01_1 floor.n.01_1)", "", "8:5: :init does not say where agent.n.01_1 is"),
        ("(not (open cabinet.n.01_1))", "(inroom cabinet.n.01_1 garage)", "13:5: cabinet.n.01_1 is in the garage al"),
        ("(or (open cabinet.n.01_1) (not (ontop teacup.n.02_1 floor.n.01_1)))", "(and)", "21:7: an empty 'and'"),
        ("(forn (1)", "(forn (3)", "20:13: 3 of teacup.n.02, of which :objects has 2: that can never be"),
        ("(forn (1)", "(forn", "20:7: '(forn (cup - teacup.n.02) (inside cup cabinet.n.01_1))' is no formula: wr"),
        ("(forn (1)", "(forn (one)", "20:13: 'one' in :goal is no whole number"),
        ("- shelf.n.01\n", "\n", "6:5: shelf.n.01_1 is listed as floor.n.01: is '- shelf.n.01' missing"),
        ("    agent.n.01_1 - agent.n.01)", "    agent.n.01_1)", "8:5: '- SYNSET' is missing after agent.n.01_1"),
        ("cabinet.n.01_1 - cabinet.n.01", "teacup.n.02_1 - cabinet.n.01", "5:5: teacup.n.02_1 is a teacup.n.02"),
        ("(:init", "(:intit", "9:4: unknown section ':intit'. Did you mean ':init'?"),
        ("  (:goal", "  (:goal (open cabinet.n.01_1))\n  (:goal", "19:3: a second :goal; the first is on line 18"),
        ("  (:goal\n", "  (:goal (open cabinet.n.01_1)\n", "19:5: warning: only the first formula of a goal counts"),
        ("floor.n.01_1))))))\n", "floor.n.01_1)))))) (done)\n", "21:78: '(done)' stands after the ')' that closes '("),
        ("kitchen)\n    (inroom shelf.n.01_1", "kitchen\n    (inroom shelf.n.01_1", "13:5: '(inroom' is not closed"),
        ("floor.n.01_1))\n  (:goal", "floor.n.01_1)\n  (:goal", "9:3: '(:init' is not closed before '(:goal' on"),
        ("floor.n.01_1))))))\n", "floor.n.01_1)))))))\n", "21:77: ')' closes nothing; '(define' is closed on line 21"),
    ],
)  # fmt: skip
def test_check_tells_what_is_wrong_with_a_problem(tmp_path: Path, old: str, new: str, said: str) -> None:
    """Line and column of the word that is meant, what would be valid, the nearest name."""
    assert GOOD.count(old) == 1
    found = checked(tmp_path, GOOD.replace(old, new))
    assert any(line.startswith(said) for line in found), found


def test_all_problems_of_a_problem_come_at_once(tmp_path: Path) -> None:
    """Each once, whatever the number of things that a quantifier is about."""
    text = GOOD.replace("(inside ?cup", "(insid ?cup").replace("cabinet.n.01_1 kitchen", "cabinet.n.01_1 kichen")
    text = text.replace("(:goal", "x (:goal") + "(more)\n"
    assert [line.split(":")[0] for line in checked(tmp_path, text)] == ["13", "18", "20", "22"]


def test_a_domain_is_told_for_what_it_is(tmp_path: Path) -> None:
    """It ends in .bddl, too."""
    (line,) = checked(tmp_path, "(define (domain mine)\n  (:predicates (open ?a)))")
    assert line.startswith("1:1: this is a domain, not a problem")


def test_an_object_may_be_listed_twice(tmp_path: Path) -> None:
    """As `bddl` takes it: it is one object, and that is a note, no problem."""
    twice = GOOD.replace("teacup.n.02_1 teacup.n.02_2 -", "teacup.n.02_1 teacup.n.02_2 teacup.n.02_1 -")
    assert parse_problem(twice, "tea") == parse_problem(GOOD, "tea")
    assert checked(tmp_path, twice) == ["4:33: note: teacup.n.02_1 is listed twice [repeated]"]
    assert CliRunner().invoke(check, [str(tmp_path)], standalone_mode=False).return_value == 0


def test_a_goal_too_large_to_be_written_out_is_refused(tmp_path: Path) -> None:
    """Quantifiers within quantifiers multiply; whoever sends such a file does not stop the machine."""
    cups = " ".join(f"teacup.n.02_{i}" for i in range(1, 40))
    goal = "(open cabinet.n.01_1)"
    for name in "abcdef":
        goal = f"(forall (?{name} - teacup.n.02) {goal})"
    found = checked(
        tmp_path, GOOD.replace("teacup.n.02_1 teacup.n.02_2", cups).replace("(forn (1) (", f"{goal} (forn (1) (")
    )
    assert [line for line in found if "[too-large]" in line]


def test_behaviors_own_problems_pass() -> None:
    """All 50 of the challenge, as they are shipped, without errors or warnings."""
    files = activities()
    for activity in human_stats():
        found = problems_in(str(files[activity]))
        assert [str(p) for p in found if p.severity != "note"] == []


def test_names_of_ones_own_are_known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A synset of the user's catalogue and a room of the user's house are no misspellings."""
    text = GOOD.replace("teacup.n.02", "moka_pot.n.01").replace(" kitchen)", " workshop)")
    found = checked(tmp_path, text)
    assert any("unknown synset 'moka_pot.n.01'" in line for line in found)
    assert any("unknown room 'workshop'" in line for line in found)
    for folder in ("catalogues", "houses"):
        (tmp_path / "root" / "tasks" / folder).mkdir(parents=True)
    entry = "{synset: moka_pot.n.01, family: can, shape: {diameter_m: 0.1, height_m: 0.2, color: '#888888'}}"
    (tmp_path / "root/tasks/catalogues/mine.yaml").write_text(f"entries:\n  moka_pot: {entry}\n")
    (tmp_path / "root/tasks/houses/mine.yaml").write_text("rooms:\n  workshop: {}\n")
    monkeypatch.setenv("MPVI_PATH", str(tmp_path / "root"))
    path = tmp_path / "tea.bddl"
    assert problems_in(str(path)) == []


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


TOKENS = re.findall(r"[()]|[^\s()]+", GOOD)


@given(
    st.lists(
        st.tuples(st.integers(0, len(TOKENS) - 1), st.integers(0, 2), st.sampled_from([*TOKENS, "?x", "x", "(", ")"])),
        min_size=1,
        max_size=4,
    )
)
def test_a_spoiled_problem_is_a_list_of_problems(changes: list[tuple[int, int, str]]) -> None:
    """Whatever words come in, go away, or take the place of others: each problem has its place in the text."""
    tokens = list(TOKENS)
    for at, gone, new in changes:
        tokens[at : at + gone] = [new]
    text = "\n".join(tokens)
    findings = Findings("tea.bddl")
    with contextlib.suppress(FileProblems):
        parse_problem(text, "tea", findings, behavior())
    assert all(1 <= p.line <= len(tokens) and p.column == 1 for p in findings.problems)
