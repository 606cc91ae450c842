"""What models say is read strictly, and never trips the reader."""

from __future__ import annotations

import contextlib
import json
import time
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.executive.language.json_answer import MOST_CHARACTERS, parse_json
from mpvi_bt.executive.language.thinking import spoken

PLAN = {"task": "t", "segments": [{"say": 'a "quoted" {brace}', "n": 1.5}, {"say": None}]}
TEXT = json.dumps(PLAN, indent=1)


def never(found: dict[str, Any]) -> bool:
    """No form is asked for, so the longest object is meant."""
    return False


@pytest.mark.parametrize(
    "answer",
    [
        TEXT,
        f"```json\n{TEXT}\n```",
        f"Sure! Here is the plan for {{room}}:\n\n```\n{TEXT}\n```\nIs there anything else?",
        f'<think>maybe {{"task": "x"}}?</think>{TEXT}',
        f"\ufeff  {TEXT}  }}",
    ],
)
def test_an_object_is_found_amid_chatter(answer: str) -> None:
    """Fenced, thought over, beside smaller ones, or as it is."""
    assert parse_json(answer, never) == PLAN


@pytest.mark.parametrize("cut", range(1, len(TEXT)))
def test_what_is_cut_off_is_no_answer(cut: int) -> None:
    """Nor is a part of it taken for the whole."""
    with pytest.raises(ValueError, match=r"."):
        parse_json(TEXT[:cut], never)


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
        parse_json(answer, never)
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
    assert parse_json(f"```json\n{text}\n```", never) == data


@given(st.text(alphabet='{}[]":,\\ \nae19-.\u2028"NI', max_size=60) | st.text(max_size=60))
def test_any_text_is_an_object_or_a_value_error(text: str) -> None:
    """Nothing else comes of it."""
    for fits in (never, lambda found: "a" in found):
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


SEGMENT = {"type": "navigation", "description": "go to the {fridge}, then wait for the door to be opened by hand"}
WHOLE = json.dumps({"name": "t", "segments": [SEGMENT] * 4}, indent=1)
AROUND = [
    ("", ""),
    ("Sure, for {room}:\n```json\n", "\n```\nAsk me for {more}."),
    ('Such as {"a": 1}: ', ' or {"a": [2]}'),
]
EARLY = [  # what is broken before the first segment, and what is expected in its place
    ('"name": "t",', '"name": "t"', "Expecting ',' delimiter"),
    ('"name": "t",', '"name" "t",', "Expecting ':' delimiter"),
    ('"name": "t",', "name: t,", "Expecting property name"),
    ('"name": "t",', "// the plan\n", "Expecting property name"),
    ('"name": "t",', '"name": "the "new" one",', "Expecting ',' delimiter"),
    ('"name": "t",', '"name": "t,', "control character"),
    ('"name": "t",', '"name": None,', "Expecting value"),
    ('"segments": [', '"segments": [,', "Expecting value"),
    ('"segments": [', '"segments": ["no" ', "Expecting ',' delimiter"),
]


@pytest.mark.parametrize(("was", "broken", "expected"), EARLY)
@pytest.mark.parametrize("cut", [0, 200])
@pytest.mark.parametrize(("begin", "end"), AROUND)
def test_a_broken_object_outranks_the_whole_ones_inside_it(
    was: str, broken: str, expected: str, cut: int, begin: str, end: str
) -> None:
    """However early it breaks, and cut off or not: it is told, never a part of it that happens to be whole."""
    text = WHOLE.replace(was, broken, 1)
    with pytest.raises(ValueError, match=expected) as error:
        parse_json(begin + (text[:-cut] if cut else text + end), is_answer)
    with pytest.raises(json.JSONDecodeError) as alone:
        json.loads(text[: -cut or None])
    line = begin.count("\n") + alone.value.lineno
    column = alone.value.colno + (len(begin) if line == 1 else 0)
    assert str(error.value).startswith(f"line {line}, column {column}: ")


def test_the_place_of_a_fault_is_that_in_what_the_model_is_shown() -> None:
    """Thinking is not shown to it again, so it does not count; what is there is quoted."""
    thought = '<think>\nperhaps {"segments": [1]}\n</think>\n\n'
    for before in ("", thought, f"Well.\n{thought}"):
        with pytest.raises(ValueError, match="line") as error:
            parse_json(f'{before}{{\n "segments" [1]}}', is_answer)
        line = 1 + len(spoken(before + "{").split("\n"))
        assert str(error.value) == f"line {line}, column 13: Expecting ':' delimiter, before '[1]}}'"


def test_the_end_of_what_is_cut_off_is_told() -> None:
    """With what was still expected there, in a fence or not."""
    for end in ("", "\n```", "  \n"):
        with pytest.raises(ValueError, match=r"line \d, column \d+, where it ends: Expecting ',' delimiter"):
            parse_json(f'{{"segments": [{{"a": 1}}, {{"b": 2}}{end}', is_answer)


@pytest.mark.parametrize(
    "text", ['[{"a": 1}, {"a": 22}]', '```json\n[\n {"a": 1}\n]\n```', 'Sure: [{"a": [{}]}, {"b": 2}].']
)
def test_a_list_is_no_answer(text: str) -> None:
    """Nor is one of its objects, whole or not the list."""
    with pytest.raises(ValueError, match="it is a list, where one object is due"):
        parse_json(text, is_answer)
    with pytest.raises(ValueError, match=r"line \d+, column \d+"):
        parse_json(text.replace("}", "},", 1).replace(",,", ", ,"), is_answer)


def test_a_later_try_that_breaks_takes_the_earlier_one_back() -> None:
    """A draft is no answer where the model began another one behind it; a fragment of something else is none."""
    draft = json.dumps({"name": "t", "segments": [1]})
    for broken in ('{"name": "t" "segments": [2]}', '{ "segments": [2', "{name: t}"):
        with pytest.raises(ValueError, match="line 2"):
            parse_json(f"{draft}\n{broken}", is_answer)
        assert parse_json(f"{broken}\n{draft}", is_answer) == json.loads(draft)
    for other in ('{"type": ..., "target": ...}', "{room}", "{...}", '{"name": "t", "segments": 3}'):
        assert parse_json(f"{draft}\n{other}", is_answer) == json.loads(draft)


@pytest.mark.parametrize("wrapped", ["\\boxed{%s}", "{%s}", "{{%s}}", '{"task": oops %s', "{plan: %s"])
def test_an_answer_within_something_broken_is_an_answer(wrapped: str) -> None:
    """If it fits as a whole: what is around it says nothing that was asked for."""
    assert parse_json(wrapped % json.dumps(ANSWER), is_answer) == ANSWER


@pytest.mark.parametrize(
    "part", ['{"a": 1} ', '{"a": ', "{", '{"a": "', "<think></think>", "</think>{}", '{"a": 1, x ']
)
def test_however_much_there_is_it_is_read_soon(part: str) -> None:
    """A megabyte of whatever."""
    began = time.monotonic()
    with contextlib.suppress(ValueError):
        parse_json(part * (MOST_CHARACTERS // len(part)), is_answer)
    assert time.monotonic() - began < 10.0
