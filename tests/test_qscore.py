"""The exact q-score."""

import itertools
import random
from collections.abc import Iterable, Mapping
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpvi_bt.house.goals.evaluate import judge, snapshot, unmet
from mpvi_bt.house.goals.formula import All, Literal, Not, Some, holds
from mpvi_bt.house.goals.problem import load_problem, parse_problem
from mpvi_bt.house.goals.qscore import best_fraction, qscore

HEAD = "(define (:objects a_1 a_2 a_3 - a b_1 b_2 - b) (:init ) (:goal {}))"
THINGS = {"a": ["a_1", "a_2", "a_3"], "b": ["b_1", "b_2"]}
EVERY: list[tuple[str, ...]] = [("p", x) for kind in THINGS.values() for x in kind] + [
    ("r", x, y) for x in THINGS["a"] for y in THINGS["b"]
]


Nested = Any  # str | list[Nested]
Option = list[tuple[tuple[str, ...], bool]]
World = dict[tuple[str, ...], bool]


def flat(parts: Iterable[list[Any]]) -> list[Any]:
    """The parts in one list."""
    return list(itertools.chain.from_iterable(parts))


@st.composite
def formulas(
    draw: st.DrawFn, depth: int = 3, names: tuple[str, ...] = ("a_1", "a_2", "b_1", "b_2"), pure: bool = False
) -> Nested:
    """A random formula as nested lists; `pure` leaves out what cannot be negated."""
    kinds = ["p", "r"]
    if depth:
        kinds += ["not", "and", "or", "forall", "exists"] + ([] if pure else ["forn", "forpairs", "fornpairs"])
    kind = draw(st.sampled_from(kinds))
    if kind == "p":
        return ["p", draw(st.sampled_from(names))]
    if kind == "r":
        a = draw(st.sampled_from([n for n in names if n[0] in "ax"]))
        return ["r", a, draw(st.sampled_from([n for n in names if n[0] in "by"]))]
    if kind == "not":
        return ["not", draw(formulas(depth - 1, names, pure=True))]
    if kind in ("and", "or"):
        return [kind, *(draw(formulas(depth - 1, names, pure)) for _ in range(draw(st.integers(1, 2))))]
    variable, synset = draw(st.sampled_from([("x", "a"), ("y", "b")]))
    if kind in ("forall", "exists"):
        return [kind, [variable, "-", synset], draw(formulas(depth - 1, (*names, variable), pure))]
    if kind == "forn":
        count = draw(st.integers(1, 2))
        return [kind, [str(count)], [variable, "-", synset], draw(formulas(depth - 1, (*names, variable)))]
    pair = [["x", "-", "a"], ["y", "-", "b"], draw(formulas(min(depth - 1, 1), (*names, "x", "y")))]
    return ["forpairs", *pair] if kind == "forpairs" else ["fornpairs", [str(draw(st.integers(1, 2)))], *pair]


def text(f: Nested) -> str:
    """A formula as BDDL."""
    return f if isinstance(f, str) else "(" + " ".join(map(text, f)) + ")"


def options(f: Nested, env: Mapping[str, str], positive: bool = True) -> list[Option]:
    """Every option of a formula by definition: lists of (literal, sign)."""
    kind = f[0]
    if kind == "not":
        return options(f[1], env, not positive)
    if kind in ("and", "or"):
        parts = [options(g, env, positive) for g in f[1:]]
    elif kind in ("forall", "exists"):
        parts = [options(f[2], {**env, f[1][0]: t}, positive) for t in THINGS[f[1][2]]]
    elif kind == "forn":
        each = [options(f[3], {**env, f[2][0]: t}) for t in THINGS[f[2][2]]]
        chosen = itertools.combinations(each, int(f[1][0]))
        return [flat(o) for parts in chosen for o in itertools.product(*parts)]
    elif kind in ("forpairs", "fornpairs"):
        n = 2 if kind == "forpairs" else int(f[1][0])
        found = []
        for rows in itertools.permutations(THINGS["a"], n):
            for columns in itertools.permutations(THINGS["b"], n):
                parts = [options(f[-1], {**env, "x": a, "y": b}) for a, b in zip(rows, columns, strict=True)]
                found += [flat(o) for o in itertools.product(*parts)]
        return found
    else:
        return [[((kind, *(env.get(n, n) for n in f[1:])), positive)]]
    if (kind in ("and", "forall")) == positive:
        return [flat(o) for o in itertools.product(*parts)]
    return flat(parts)


def worlds(seed: int) -> tuple[World, World]:
    """The truth of every literal at the start and at the end."""
    rng = random.Random(seed)
    start, end = ({literal: rng.random() < 0.5 for literal in EVERY} for _ in range(2))
    return start, end


@settings(max_examples=200, deadline=None)
@given(formulas(depth=2), st.integers(0, 2**32))
def test_q_is_the_maximum_over_all_options(formula: Nested, seed: int) -> None:
    """Without listing options, q equals the best one found by listing them all, contradictory ones dropped."""
    start, end = worlds(seed)
    listed = options(formula, {})
    consistent = [o for o in listed if not any((literal, not sign) in o for literal, sign in o)]
    shares = [sum(start[k] != s and end[k] == s for k, s in o) / len(o) for o in consistent]
    goal = parse_problem(HEAD.format(text(formula)), "random").goal
    best = best_fraction(goal, lambda k, s: start[(k.predicate, *k.args)] != s and end[(k.predicate, *k.args)] == s)
    assert best == max(shares, default=0.0)


@settings(max_examples=200, deadline=None)
@given(formulas(pure=True), st.integers(0, 2**32))
def test_a_goal_is_true_exactly_when_some_option_is(formula: Nested, seed: int) -> None:
    """Truth and options agree wherever BDDL's quantifiers are the logical ones."""
    _, end = worlds(seed)
    goal = parse_problem(HEAD.format(text(formula)), "random").goal
    satisfied = any(all(end[k] == sign for k, sign in option) for option in options(formula, {}))
    assert holds(goal, lambda k: end[(k.predicate, *k.args)]) == satisfied


def test_a_reached_goal_scores_one_even_if_nothing_is_new() -> None:
    """Success is 1.0 whatever held at the start."""
    goal = All((Literal("p", ("a",)), Not(Literal("p", ("b",)))))
    state = {"a": True, "b": False}
    assert qscore(goal, lambda k: state[k.args[0]], lambda k: state[k.args[0]]) == 1.0


def test_what_held_from_the_start_earns_nothing_but_counts() -> None:
    """One of three literals is new, one was there, one is missing: q is 1/3 and the plain fraction 2/3."""
    problem = parse_problem(HEAD.format("(and (p a_1) (p a_2) (p a_3))"), "three")
    start = snapshot(problem, lambda k: k.args == ("a_1",))
    end = snapshot(problem, lambda k: k.args in (("a_1",), ("a_2",)))
    report = judge(problem, start, end)
    assert (report.satisfied, report.q, report.fraction, report.conditions_met) == (False, 1 / 3, 2 / 3, 2 / 3)
    assert [(c.text, c.satisfied) for c in report.conditions] == [("p(a_1)", True), ("p(a_2)", True), ("p(a_3)", False)]


def test_conditions_are_counted_whatever_options_they_have() -> None:
    """Of `some a` and b, the second holds: half of the conditions, and half of either option's literals.

    Of `some pair of a`, of which one holds, no condition is met, but a half of the best option.
    """
    some = parse_problem(HEAD.format("(and (exists (?x - a) (p ?x)) (p b_1))"), "some")
    report = judge(some, snapshot(some, lambda _: False), snapshot(some, lambda k: k.args == ("b_1",)))
    assert (report.q, report.fraction, report.conditions_met) == (1 / 2, 1 / 2, 1 / 2)
    pair = parse_problem(HEAD.format("(forn (2) (?x - a) (p ?x))"), "pair")
    report = judge(pair, snapshot(pair, lambda _: False), snapshot(pair, lambda k: k.args == ("a_3",)))
    assert (report.q, report.fraction, report.conditions_met) == (1 / 2, 1 / 2, 0.0)


def test_an_option_that_contradicts_itself_is_none() -> None:
    """`p and not p` can never be reached, so what it would credit does not count."""
    p, r = Literal("p", ("a",)), Literal("r", ("a",))
    goal = Some((All((p, r, Not(p))), All((p, Literal("s", ("a",)), Literal("t", ("a",))))))
    assert best_fraction(goal, lambda literal, positive: literal in (p, r)) == 1 / 3


def test_the_largest_goal_is_scored_at_once() -> None:
    """storing_food has 1.7 million options; a wrong method would never end."""
    problem = load_problem("storing_food").expanded({"cabinet.n.01": 6})
    start = snapshot(problem, lambda _: False)
    literals = sorted(start, key=str)
    end = {literal: literal == literals[0] for literal in literals}
    assert judge(problem, start, end).q == pytest.approx(1 / 8)


def test_conditions_name_the_things_they_are_about() -> None:
    """Written-out conditions tell one pumpkin from the other."""
    problem = load_problem("putting_away_Halloween_decorations")
    nothing = snapshot(problem, lambda _: False)
    texts = [c.text for c in judge(problem, nothing, nothing).conditions]
    assert "some cabinet.n.01: (inside pumpkin.n.02_2 cabinet.n.01)" in texts


def test_unmet_lists_the_start_facts_that_do_not_hold() -> None:
    """A sampler is told what to mend, and nothing about rooms or the robot's own place."""
    problem = load_problem("picking_up_trash")
    missing = unmet(problem, lambda k: k.args[0] != "can__of__soda.n.01_2")
    assert [f.literal for f in missing] == [Literal("ontop", ("can__of__soda.n.01_2", "floor.n.01_1"))]


def test_a_goal_of_half_of_many_things_is_scored_in_time() -> None:
    """There are 1.4e11 ways to choose 20 of 40; none of them is listed."""
    things = " ".join(f"a_{i}" for i in range(40))
    text = f"(define (:objects {things} - a) (:init ) (:goal (forn (20) (?x - a) (p ?x))))"
    goal = parse_problem(text, "many").goal
    done = {Literal("p", (f"a_{i}",)) for i in range(5)}
    assert qscore(goal, lambda literal: False, lambda literal: literal in done) == 5 / 20
