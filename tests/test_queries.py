"""Laws of what is counted of an episode's questions, and of the truth that they are held against."""

from __future__ import annotations

import json
from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.executive.behaviors.context import Query
from mpvi_bt.executive.completion.oracle import OracleChecker
from mpvi_bt.executive.ticking.loop import run_episode
from mpvi_bt.executive.ticking.saved_run import SavedRun, save_run
from mpvi_bt.ground.cost import Cost
from mpvi_bt.ground.marked_yaml import SourceMarks, validate_data
from mpvi_bt.runs.choices.world_truth import Audit
from mpvi_bt.runs.episode.queries import Queries, count_queries, queries_text
from tests.bench import HELD, PICK, Bench, tree
from tests.test_checkers import PHRASES, Facts

COST = Cost("tiny", 900, 2)


def query(complete: bool, fault: str = "", latency_s: float = 0.0, cost: Cost | None = None) -> Query:
    """One question; without an answer there is no yes."""
    return Query("c", "grasp", "head", complete and not fault, "r", "t/check", 0.0, latency_s, fault, cost)


ASKED = st.builds(
    query,
    st.booleans(),
    st.sampled_from(["", "", "bad_answer", "refused", "model_timeout"]),
    st.floats(0, 60),
    st.sampled_from([None, COST, Cost("tiny", 900, 2, True)]),
)


@given(st.lists(st.tuples(ASKED, st.sampled_from([True, False, None])), max_size=30))
def test_every_question_is_counted_once(asked: list[tuple[Query, bool | None]]) -> None:
    """Yes and no; right, wrong and unknown; malformed, refused and unanswered."""
    queries, truths = [q for q, _ in asked], [t for _, t in asked]
    counted = count_queries(queries, truths, tree(PICK).spec)
    assert (counted.units, counted.asked) == (1, len(asked))
    assert counted.yes == sum(q.complete for q in queries)
    right = sum(q.complete is t for q, t in asked if not q.fault)
    faults = counted.malformed + counted.refused + counted.errors
    assert counted.false_yes + counted.false_no + counted.unknown + right + faults == counted.asked
    assert faults == sum(bool(q.fault) for q in queries)
    assert counted.tokens_in == 900 * sum(q.cost is not None for q in queries)
    assert counted.kept <= counted.asked
    assert bool(queries_text([counted])) == bool(asked)


def test_a_question_whose_truth_nobody_noted_is_unknown() -> None:
    """As of an episode that an exception cut short."""
    counted = count_queries([query(True), query(True)], [False], tree(PICK).spec)
    assert (counted.false_yes, counted.unknown) == (1, 1)


def test_questions_are_told_on_one_line() -> None:
    """What did not happen is left out."""
    assert queries_text([Queries()]) == ""
    assert queries_text([Queries(units=1, asked=2, yes=1)]) == "2 asked in 1 unit, 1 yes, 1 no"
    full = Queries(units=2, asked=9, yes=3, false_yes=1, false_no=2, malformed=1, refused=1, errors=1, latency_s=4.5,
                   tokens_in=900, tokens_out=9, kept=3)  # fmt: skip
    assert queries_text([full, Queries(units=1)]) == (
        "9 asked in 3 units, 3 yes (1 false), 3 no (2 false), 1 neither yes nor no, 1 refused, 1 without an answer, "
        "4.5 s waited for, 909 tokens, 3 answers from file"
    )


def test_the_last_question_without_an_answer_says_why() -> None:
    """In the result and in the line for a person; where every question was answered there is nothing to say."""
    broken = replace(query(False, "server_error"), reason="server_error: it broke (500)")
    counted = count_queries([broken, replace(broken, reason="later: (503)"), query(True)], [], tree(PICK).spec)
    assert counted.last_fault == "later: (503)"
    assert queries_text([counted, Queries(asked=1)]).endswith(". The last one without a plain answer: later: (503)")
    assert count_queries([query(True), query(False)], [], tree(PICK).spec).last_fault == ""


def test_a_stopped_run_remembers_what_its_questions_cost() -> None:
    """Through the file, and with the truths that were noted before."""
    bench = Bench(PICK)
    bench.tick()
    bench.context.log.queries.append(query(True, "", 1.5, COST))
    back = validate_data(json.loads(save_run(bench.tree, bench.world).model_dump_json()), SourceMarks("x"), SavedRun)
    assert back.queries == bench.context.log.queries
    audit = Audit(OracleChecker(Facts(), PHRASES), [False])
    audit.step(bench.tree, bench.world)
    assert audit.truths == [False]


def test_the_truth_is_noted_when_an_answer_comes_and_nothing_in_the_tree_sees_it() -> None:
    """A false yes ends the unit all the same; it is counted afterwards."""
    for criterion, so in (("the trash can is held in a gripper", False), ("the can of soda is held", True)):
        bench = Bench(PICK.replace(HELD, criterion), {criterion: (True,)})
        audit = Audit(OracleChecker(Facts(), PHRASES))
        outcome = run_episode(bench.tree, bench.world, bench.context, [audit])
        assert outcome.ending == "success"
        assert audit.truths == [so]
        assert count_queries(outcome.log.queries, audit.truths, bench.tree.spec).false_yes == (not so)


def test_what_the_oracle_cannot_decide_is_unknown() -> None:
    """A criterion that it does not understand, and a thing that is not there."""
    oracle = OracleChecker(Facts(), PHRASES)
    for criterion in ("all is well", "the unicorn is held in a gripper"):
        assert oracle.decide(criterion)[0] is None
        assert not oracle.check(criterion, None).complete
