"""What models say is read strictly, and never trips the reader."""

from __future__ import annotations

import contextlib
import json
import time
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.language.json_answer import MOST_CHARACTERS, parse_json

PLAN = {"task": "t", "segments": [{"say": 'a "quoted" {brace}', "n": 1.5}, {"say": None}]}
TEXT = json.dumps(PLAN, indent=1)


@pytest.mark.parametrize(
    "answer",
    [
        TEXT,
        f"```json\n{TEXT}\n```",
        f"Sure! Here is the plan for {{room}}:\n\n```\n{TEXT}\n```\nIs there anything else?",
        f'<think>maybe {{"task": "x"}}?</think>{TEXT}',
        f"\ufeff  {TEXT}  }}",
        f'{{"task": oops {TEXT}',
    ],
)
def test_an_object_is_found_amid_chatter(answer: str) -> None:
    """Fenced, thought over, beside smaller ones, or as it is."""
    assert parse_json(answer) == PLAN


@pytest.mark.parametrize("cut", range(1, len(TEXT)))
def test_what_is_cut_off_is_no_answer(cut: int) -> None:
    """Nor is a part of it taken for the whole."""
    with pytest.raises(ValueError, match=r"."):
        parse_json(TEXT[:cut])


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        ("", "no { begins one"),
        ("I am sorry, Dave.", "no {"),
        ("[1, 2, 3]", "no {"),
        ('{"a": [{"b": 1},, {"c": 2}]}', "Expecting value"),
        ('{"a": 1,}', "Illegal trailing comma|Expecting property name"),
        ('{"a": NaN}', "NaN"),
        ('{"a": -Infinity}', "Infinity"),
        ('{"a": 1e999}', "too large"),
        ('{"a": 1' + "0" * 5000 + "}", "."),
        ('{"a": 1, "a": 2}', "'a' stands twice"),
        ('{"a": "line\nbreak"}', "control character"),
        ('{"a":' * 100_000, "deep"),
        ('{"a":' + "[" * 100 + "]" * 100 + "}", "deep"),
        ("[" * 100_000, "no {"),
        ("{" * 1_000_000, "braces"),
        ('{"a": "' + "x" * MOST_CHARACTERS + '"}', "more than"),
    ],
    ids=lambda value: str(value)[:20],
)
def test_what_is_no_plain_json_is_told(answer: str, why: str) -> None:
    """As a ValueError that says what is wrong, soon."""
    began = time.monotonic()
    with pytest.raises(ValueError, match=why):
        parse_json(answer)
    assert time.monotonic() - began < 10.0


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


@given(st.dictionaries(st.text(), values, max_size=4), st.booleans())
def test_every_object_is_read_back(data: dict[str, Any], ascii_only: bool) -> None:
    """As it was written, fenced or not."""
    text = json.dumps(data, ensure_ascii=ascii_only)
    assert parse_json(f"```json\n{text}\n```") == data


@given(st.text(alphabet='{}[]":,\\ \nae19-.\u2028"NI', max_size=60) | st.text(max_size=60))
def test_any_text_is_an_object_or_a_value_error(text: str) -> None:
    """Nothing else comes of it."""
    for fits in (None, lambda found: "a" in found):
        with contextlib.suppress(ValueError):
            assert isinstance(parse_json(text, fits), dict)


# Of several objects, which is meant

DRAFT = {"segments": ["draft", {"n": 1, "long": "er than the answer" * 9}]}
ANSWER = {"segments": ["answer"]}
MARKS = [
    ("", "\n\n"),
    ("", "</think>"),
    ("<think>", "</think>"),
    ("<think>\n\n</think>\n<think>", "</think>"),
    ("<thinking>I <think> so. ", "</thinking>"),
    ("<THOUGHT>", "</THOUGHT>"),
    ("<seed:think>", "</seed:think>"),
    ("<reasoning>", "</reasoning>\n<answer>"),
    ("[THINK]", "[/THINK]"),
    ("\u25c1think\u25b7", "\u25c1/think\u25b7"),
    ("<|begin_of_thought|>", "<|end_of_thought|>\n<|begin_of_solution|>"),
    ("<|channel|>analysis<|message|>", "<|end|><|start|>assistant<|channel|>final<|message|>"),
    ("analysis", "assistantfinal"),
    ("## Reasoning\n", "## Final answer\n"),
    ("**Thought process:** ", "\n\n**Answer:** "),
    ("For example:\n```json\n", "\n```\nFinal answer\n"),
]
MALFORMED = [
    '{"segments": ["draft",, ' + "1, " * 500 + "]}",
    '{"segments": ["draft" ' + '{"a": [{}, {"segments": 3}], ' * 40,
    '{"segments": [NaN], "n": [' + "1, " * 500 + "1]}",
    '{"segments": [], "segments": [' + "1, " * 500 + "1]}",
    '{"segments": [1e999' + ", 1" * 500 + "]}",
    '{"segments": [1' + "0" * 5000 + "]}",
    '{"segments": "dra\nft' + "x" * 999,
    '{"segments": [' + "[" * 70 + "]" * 70 + "]}",
    '{"a":' * 20_000 + "1" + "}" * 20_000,
    "{" * 999,
    "{plan: bathtub, fridge}",
]
OTHERS = [
    "I go to the {room}. ",
    '{"note": "no plan", "segments": 3}',
    "[1, {}]",
    "No, better: ",
    "```json\n",
    "\u2028",
]


def is_answer(found: dict[str, Any]) -> bool:
    """Whether an object has the form that is asked for."""
    return isinstance(found.get("segments"), list)


before = st.lists(st.sampled_from([json.dumps(DRAFT), json.dumps(DRAFT, indent=1), *MALFORMED, *OTHERS]), max_size=5)
after = st.lists(
    st.sampled_from(
        ["\n```", "}", "</answer>", "<|return|>", ' Is {"that": "all"}?', '{"segments": 3}', " {room}", "."]
    ),
    max_size=3,
)
dressed = st.sampled_from(
    [ANSWER, {"plan": ANSWER}, {"name": "plan", "arguments": ANSWER, "id": {}}, {"a": {"b": ANSWER}}]
)


@given(before, st.sampled_from(MARKS), dressed, st.sampled_from([None, 1]), after)
def test_the_last_whole_object_that_fits_is_meant(
    drafts: list[str], marks: tuple[str, str], answer: dict[str, Any], indent: int | None, chatter: list[str]
) -> None:
    """After thinking, drafts, worked examples and longer broken ones, marked in whatever way; wrapped; amid chatter."""
    text = "".join([marks[0], *drafts, marks[1], json.dumps(answer, indent=indent), *chatter])
    assert parse_json(text, is_answer) == ANSWER


@pytest.mark.parametrize(("begin", "end"), [marks for marks in MARKS if marks[1].startswith(("<", "[", "\u25c1"))])
def test_thinking_is_no_answer(begin: str, end: str) -> None:
    """A model that drafts and then answers otherwise has not answered with its draft."""
    draft = json.dumps(DRAFT)
    for said in ("I am sorry, I cannot do that.", "", '{"segments": ["ans'):
        with pytest.raises(ValueError, match=r"after the thinking|Unterminated"):
            parse_json(f"{begin}Maybe {draft}{end}{said}", is_answer)
    assert parse_json(f"{json.dumps(ANSWER)}<think>{draft}? No.</think>", is_answer) == ANSWER


def test_marks_within_the_answer_are_a_part_of_it() -> None:
    """Whatever its texts say; and thinking that does not end is no reason to lose an answer."""
    odd = {"segments": ["</think>", "<think>", "[/THINK]"]}
    assert parse_json(f"<think>{json.dumps(DRAFT)}</think>{json.dumps(odd)}", is_answer) == odd
    assert parse_json(f"<think>{json.dumps(DRAFT)}. Finally: {json.dumps(ANSWER)}", is_answer) == ANSWER


def test_what_fits_none_is_the_longest() -> None:
    """For a check to tell what is wrong; or it is told where a longer one breaks."""
    assert parse_json('{"segments": 1, "b": 22} {"a": 1}', is_answer) == {"segments": 1, "b": 22}
    with pytest.raises(ValueError, match="Expecting"):
        parse_json('{"a": 1} {"segments": [1, 2, 3,, 4]}', is_answer)


@pytest.mark.parametrize(
    "part", ['{"a": 1} ', '{"a": ', "{", '{"a": "', "<think></think>", "</think>{}", '{"a": 1, x ']
)
def test_however_much_there_is_it_is_read_soon(part: str) -> None:
    """A megabyte of whatever."""
    began = time.monotonic()
    with contextlib.suppress(ValueError):
        parse_json(part * (MOST_CHARACTERS // len(part)), is_answer)
    assert time.monotonic() - began < 10.0
