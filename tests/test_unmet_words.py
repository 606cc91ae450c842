"""What of a goal does not hold is told in words."""

from __future__ import annotations

import pytest

from mpvi_bt.ground.human import human_stats
from mpvi_bt.ground.words.phrases import plural
from mpvi_bt.house.goals.formula import All, Exactly, Formula, Literal, Not, Pairs, Some, holds
from mpvi_bt.house.goals.problem import load_problem
from mpvi_bt.house.goals.unmet_words import UnmetWords

THINGS = ("can_1", "can_2", "can_3", "wreath_1", "bin_1", "jar_1", "jar_2", "mud_1")


def told(*goal: Formula, true: tuple[Literal, ...] = ()) -> list[str]:
    return UnmetWords(true.__contains__, lambda thing: thing.partition("_")[0], THINGS).sentences(goal)


def of(predicate: str, *args: str) -> Literal:
    return Literal(predicate, args)


CANS = [of("inside", can, "bin_1") for can in THINGS[:3]]
IN_JARS = [[of("inside", can, jar) for jar in ("jar_1", "jar_2")] for can in ("can_1", "can_2")]


@pytest.mark.parametrize(
    ("goal", "true", "sentences"),
    [
        (CANS, CANS, []),
        (CANS, CANS[:2], ["one can is not in the bin"]),
        (CANS, CANS[:1], ["two cans are not in the bin"]),
        ([*CANS, of("inside", "wreath_1", "bin_1")], CANS[:1], ["two cans and the wreath are not in the bin"]),
        ([Not(of("open", "bin_1"))], [of("open", "bin_1")], ["the bin is open"]),
        ([Not(of("covered", "bin_1", "mud_1"))], [of("covered", "bin_1", "mud_1")], ["the bin is covered with mud"]),
        ([of("nextto", "can_1", "can_2")], [], ["one can is not next to another can"]),
        ([of("contains", "bin_1", "wreath_1")], [], ["the wreath is not in the bin"]),
        ([of("inside", "wreath_1", "jar_1")], [], ["the wreath is not in a certain jar"]),
        ([of("real", "wreath_1"), of("inside", "wreath_1", "bin_1")], [], ["the wreath is not there"]),
        ([Not(of("real", "wreath_1"))], [of("real", "wreath_1")], ["the wreath is still there"]),
        ([Some(tuple(IN_JARS[0]))], [], ["one can is not in a jar"]),
        ([Some((of("filled", "jar_1", "mud_1"), of("filled", "jar_2", "mud_1")))], [], ["no jar is filled with mud"]),
        (
            [Some((of("nextto", "wreath_1", "bin_1"), of("under", "wreath_1", "bin_1")))],
            [],
            ["the wreath is not next to or under the bin"],
        ),
        (
            [Some((All((IN_JARS[0][0], IN_JARS[1][0])), All((IN_JARS[0][1], IN_JARS[1][1]))))],
            [IN_JARS[1][1]],
            ["one can is not in a jar"],
        ),
        ([Exactly(1, tuple(CANS))], CANS[:2], ["two cans are in the bin, and the goal wants one"]),
        ([Exactly(2, tuple(CANS))], [], ["no can is in the bin, and the goal wants two"]),
        ([Pairs(2, tuple(map(tuple, IN_JARS)))], IN_JARS[0][:1], ["one can is not in a jar of its own"]),
    ],
)
def test_what_does_not_hold_is_told_in_words(goal: list[Formula], true: list[Literal], sentences: list[str]) -> None:
    """Things that lack the same are counted; of several ways the nearest is told."""
    assert told(*goal, true=tuple(true)) == sentences


@pytest.mark.parametrize("task", sorted(human_stats()))
@pytest.mark.parametrize("true", [False, True])
def test_every_goal_has_words(task: str, true: bool) -> None:
    """Where nothing holds, and where all does that may: no sentence has a name or a form of BDDL in it."""
    problem = load_problem(task)
    words = UnmetWords(lambda _: true, lambda thing: problem.objects[thing].partition(".")[0], problem.objects)
    sentences = words.sentences(problem.conditions)
    assert sentences or holds(problem.goal, lambda _: true)
    assert not [s for s in sentences if ".n." in s or "(" in s or "this does not hold" in s]


@pytest.mark.parametrize(
    ("noun", "several"),
    [
        ("can of soda", "cans of soda"),
        ("candle", "candles"),
        ("box", "boxes"),
        ("pen box", "pen boxes"),
        ("toy", "toys"),
        ("candy", "candies"),
        ("knife", "knives"),
        ("glass", "glasses"),
        ("pliers", "pliers"),
        ("boxing gloves", "boxing gloves"),
    ],
)
def test_plurals(noun: str, several: str) -> None:
    """The first noun of a name has the plural's ending; what is one stays."""
    assert plural(noun) == several
