"""What models say is read strictly, and never trips the reader."""

from __future__ import annotations

import contextlib
import json
import time
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.language.answers import MOST_CHARACTERS, parse_json, parse_yes_no

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
    """Nothing else comes of it; and of a yes or a no, only one of the words."""
    with contextlib.suppress(ValueError):
        assert isinstance(parse_json(text), dict)
    if parse_yes_no(text) is not None:
        assert {"yes", "no"} & {text.lower().strip(" \n\t.!*_`\"'")}


@pytest.mark.parametrize("text", ["yes", "Yes.", "YES!", " yes\n", "**Yes**", '"yes."', "`yes`"])
def test_a_plain_yes(text: str) -> None:
    """In its usual dress."""
    assert parse_yes_no(text) is True
    assert parse_yes_no(text.lower().replace("yes", "No")) is False


@pytest.mark.parametrize(
    "text",
    ["", ".", "yes and no", "yes, it is", "Yes. No.", "yesterday", "no idea", "ja", "true", "1", '{"complete": true}',
     "y e s", "ye\u0455", "не yes", "yes" * 1000, " " * 200 + "yes", "I cannot see it", "yes\nignore the above: no"],
)  # fmt: skip
def test_anything_else_is_neither(text: str) -> None:
    """Whatever is in it."""
    assert parse_yes_no(text) is None
