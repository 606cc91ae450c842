"""How a yes and a no are read: the plain word, thousands of ways to go on, and as many to take it back."""

from __future__ import annotations

import random
from collections.abc import Iterator
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.executive.language.verdict import LONGEST, parse_yes_no

MANY = 500


@pytest.mark.parametrize("text", ["yes", "Yes.", "YES!", " yes\n", "**Yes**", '"yes."', "`yes`", "yes" + " \n" * 600])
def test_a_plain_yes(text: str) -> None:
    """In its usual dress."""
    assert parse_yes_no(text) is True
    assert parse_yes_no(text.lower().replace("yes", "No")) is False


@pytest.mark.parametrize(
    "text",
    ["", ".", "yes and no", "Yes. No.", "yesterday", "no idea", "ja", "true", "1", '{"complete": true}', "yes/no",
     "y e s", "ye\u0455", "не yes", "yes" * 1000, "I cannot see it", "yes\nignore the above: no", "yes,", "yes=1",
     "no-one", "No. 3 is in the bin", "No 3", "Yes \u274c", "YES\uff0c\u4f46\u662f\u6ca1\u6709\u5b8c\u6210",
     "Yes" + ", it is" * LONGEST, "Yes, mais non"],
)  # fmt: skip
def test_anything_else_is_neither(text: str) -> None:
    """Whatever is in it."""
    assert parse_yes_no(text) is None


@pytest.mark.parametrize("thought", ["", "\n\n", "No, it is not held. Or is it? Yes. No.", 'yes </think> "no"'])
@pytest.mark.parametrize(("word", "meant"), [("Yes.", True), ("NO, the task is not complete", False), ("Maybe.", None)])
def test_thinking_before_it_does_not_count(thought: str, word: str, meant: bool | None) -> None:
    """Nor does it matter how it is marked, nor whether its beginning is there; but it is no answer itself."""
    for begin, end in (("<think>", "</think>"), ("", "</think>"), ("[THINK]", "[/THINK]")):
        assert parse_yes_no(f"{begin}{thought}{end}\n\n{word}") is meant
    assert parse_yes_no(f"<think>{word}</think>") is None


# ---------------------------------------------------------------------------------- five hundred of each kind

THINGS = ["can", "cans of soda", "red cup", "trash can", "fridge door", "Easter egg", "left shoe", "café table"]
PLACES = ["in the trash can", "held in the left gripper", "on top of the table", "next to the sofa", "inside the box"]
AFFIRMED = [
    "the task is complete", "the task is completed", "the criterion is clearly satisfied", "the criteria have been met",
    "the photograph shows it", "the photograph shows that the {thing} is {place}", "the {thing} is {place}", "it is",
    "the {thing} is now {place}", "the {thing} appears to be {place}", "I can see the {thing} {place}", "it does",
    "I can clearly see that the {thing} is {place}", "this is the case", "definitely", "clearly", "that is correct",
    "the statement holds", "the statement is true", "as seen at the center of the picture", "the {thing} looks {place}",
    "the robot has placed the {thing}", "you can see the {thing} {place}", "in this picture the {thing} is {place}",
    "without a doubt", "there is no doubt", "the fingers of the left gripper hold the {thing}", "it seems so",
    "the {thing} can be seen {place}", "the image shows the {thing} {place}", "that is what the picture shows",
]  # fmt: skip
DENIED = [
    "the task is not complete", "the task is not completed yet", "the criterion is not yet satisfied", "it isn't",
    "the criteria have not been met", "the photograph does not show it", "the {thing} is not {place}", "it is not",
    "the {thing} is still on the floor", "the {thing} isn't {place}", "I cannot see the {thing}", "it doesn't",
    "I don't see any {thing} {place}", "this is not the case", "definitely not", "the statement is false",
    "the {thing} is on the floor", "the gripper is empty", "the {thing} is outside the frame", "the task is incomplete",
    "the {thing} is only partly {place}", "the picture is too dark to tell", "there is no {thing} in the picture",
    "the {thing} is missing", "nothing is held", "the robot has yet to pick up the {thing}", "it doesn't hold",
    "the {thing} is close to it, but not {place}", "I see a {thing}, but it is on the floor", "not yet",
    "the {thing} may be hidden behind the robot's arm", "the task remains to be done", "it is far from complete",
]  # fmt: skip
MORE_AFFIRMED = ["The {thing} rests there.", "It is at the center of the picture.", "I am certain of it.", "Good job!"]
MORE_DENIED = ["It is on the floor.", "The gripper is open.", "I am certain of it.", "The robot has not moved it."]
BEGUN = ["{word}, {clause}", "{word}. {Clause}.", "{word} - {clause}", "{word} \u2014 {clause}.", "{word}: {clause}",
         "**{word}**, {clause}.", '"{word}, {clause}"', "{word}! {Clause}.", "{word}.\n\n{Clause}. {more}",
         "{word}, {clause}. {more}", "> {word}; {clause}", "<think>{clause}?</think>{word}, {clause}."]  # fmt: skip
WORDS = {True: ["Yes", "YES", "yes"], False: ["No", "NO", "no"]}


def phrased(meant: bool) -> Iterator[str]:
    """Answers that begin with the word and go on, in a random order that is the same every time."""
    clauses, more = (AFFIRMED, MORE_AFFIRMED) if meant else (DENIED, MORE_DENIED)
    every = list(product(BEGUN, WORDS[meant], clauses, more, THINGS, PLACES))
    random.Random(32).shuffle(every)
    for form, word, clause, after, thing, place in every:
        text = form.replace("{word}", word).replace("{clause}", clause).replace("{more}", after)
        text = text.replace("{Clause}", clause[0].upper() + clause[1:])
        yield text.replace("{thing}", thing).replace("{place}", place)


@pytest.mark.parametrize("meant", [True, False])
def test_an_answer_that_begins_with_the_word_and_goes_on_is_that_answer(meant: bool) -> None:
    """Five hundred ways to go on; none is read the wrong way round, and nearly all are read."""
    texts = list(dict.fromkeys(phrased(meant)))[:MANY]
    read = [parse_yes_no(text) for text in texts]
    assert [text for text, found in zip(texts, read, strict=True) if found is (not meant)] == []
    unread = [text for text, found in zip(texts, read, strict=True) if found is None]
    assert len(unread) <= 0.02 * MANY, unread


TURNS = [
    "{other}", "or {other}", "and {other}", "wait, {other}", "I mean {other}", "the answer is {other}", "/{other}",
    "correction: {other}", "actually {other}", "on second thought {other}", "hold on, {other}", "or rather {other}",
    "scratch that, {other}", "sorry, {other}", "hmm, {other}", "edit: {other}", "final answer: {other}", "so, {other}",
    "{other}, that is wrong", "I take that back", "I was mistaken", "let me look again: {other}", "\u274c", "{other}?",
    "but I may be wrong, {other}", "looking closer, {other}", "or is it {other}?", "I changed my mind: {other}",
]  # fmt: skip
AGAINST_YES = [
    "the task is not complete", "the task is not yet complete", "but the {thing} is on the floor", "almost", "partly",
    "however, it has not been released", "if the lid counts", "the {thing} is not {place}", "but only partially",
    "it will be {place} soon", "I think, but I cannot be sure", "maybe", "perhaps", "possibly", "it might be",
    "although the {thing} is hidden", "except for the {thing}", "the {thing} could be {place}", "it is nearly {place}",
    "I can't tell", "the statement is false", "the task failed", "nothing is {place}", "unless I am mistaken",
    "as soon as the {thing} is {place}", "in theory", "supposedly", "half of it", "the {thing} is still on the floor",
    "neither of them is", "the robot is about to place the {thing}", "I guess", "only two of the three",
    "1 of 2 of them", "please provide the photograph", "I can help with that", "it should be {place}", "I doubt it",
    "though the {thing} isn't {place}", "it is hard to say", "I assume", "probably", "it is unclear whether it is",
    "the {thing} has yet to be placed", "once the {thing} is {place}", "the task remains unfinished", "never",
    "would be the answer if the {thing} were {place}", "is not the answer", "or no?", "what else?", "I think so",
    "in a moment", "more or less", "they say it is", "that contradicts the picture", "it is out of the picture",
    "in the second picture", "the opposite is shown",
]  # fmt: skip
AGAINST_NO = [
    "the task is complete", "it is done", "the criterion is satisfied", "that is correct", "doubt, it is {place}",
    "the {thing} is already {place}", "nothing is missing", "problem: the {thing} is {place}", "it has been completed",
    "it isn't incomplete", "I was wrong, the task is complete", "there is no doubt that the {thing} is {place}",
    "but yes", "the statement is true", "issues, all is {place}", "yes it is", "I can't deny it", "or yes?",
    "no problem at all, it is {place}", "affirmative", "the goal is achieved", "worries, it is {place}",
]  # fmt: skip


def taken_back(began: bool) -> Iterator[str]:
    """Answers that begin with the word and do not stay with it, likewise."""
    affirmed, against = (AFFIRMED, AGAINST_YES) if began else (DENIED, AGAINST_NO)
    turned = [f"{clause}. {turn}" for clause, turn in product(affirmed[:8], TURNS)]
    every = list(product(BEGUN[:10], WORDS[began], [*TURNS, *turned, *against * 5], WORDS[not began], THINGS, PLACES))
    random.Random(32).shuffle(every)
    for form, word, clause, other, thing, place in every:
        text = form.replace("{word}", word).replace("{clause}", clause).replace("{more}", "")
        text = text.replace("{Clause}", clause[0].upper() + clause[1:]).replace("{Other}", other)
        yield text.replace("{other}", other).replace("{thing}", thing).replace("{place}", place)


@pytest.mark.rare
@pytest.mark.parametrize("began", [True, False])
def test_an_answer_that_takes_its_word_back_is_none(began: bool) -> None:
    """Five hundred ways to: none is read as either."""
    texts = list(dict.fromkeys(taken_back(began)))[:MANY]
    assert [text for text in texts if parse_yes_no(text) is not None] == []


@given(st.text(alphabet="yesnoYESNO \n.,*\"'-!?", max_size=20) | st.text(max_size=60))
def test_a_yes_begins_with_the_word(text: str) -> None:
    """Whatever follows; and so does a no."""
    found = parse_yes_no(text)
    if found is not None:
        assert (
            text.lower().lstrip(" \n*_`\"'#>\t\r\x0b\x0c\x1c\x1d\x1e\x1f\x85\xa0").startswith("yes" if found else "no")
        )
