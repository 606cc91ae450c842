"""Reading files with marks, and what is said about broken ones."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field

from mpvi_bt.ground.errors import FileProblems, UserError
from mpvi_bt.ground.import_paths import IMPORT_PATH
from mpvi_bt.ground.marked_yaml import (
    MAX_DEPTH,
    MAX_NODES,
    MAX_PROBLEMS,
    Record,
    Synset,
    load_marked,
    parse_marked,
    pointer,
    validate,
    validate_data,
)


class Box(Record):
    """Of the tests."""

    shape: Literal["box"]
    size_m: float = Field(gt=0)


class Ball(Record):
    """Of the tests."""

    shape: Literal["ball"]
    radius_m: float


class House(Record):
    """Of the tests."""

    name: str
    solids: list[Annotated[Box | Ball, Field(discriminator="shape")]] = []
    by_name: dict[str, Ball] = {}


def problems(text: str, model: type[Record] = House) -> list[tuple[int, int, str]]:
    """(line, column, code) of each problem of a text."""
    with pytest.raises(FileProblems) as caught:
        validate_data(*parse_marked(text, "house.yaml"), model)
    return [(p.line, p.column, p.code) for p in caught.value.problems]


JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**15), 10**15)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(st.characters(min_codepoint=32, max_codepoint=0xD7FF, exclude_characters="\x7f"), max_size=20).filter(
        str.isprintable
    ),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.text("abcdefgh 1.~", min_size=1, max_size=6), inner, max_size=4)
    ),
    max_leaves=15,
)


@given(JSON, st.sampled_from([None, 2, "\t"]), st.booleans())
def test_json_reads_as_json(data: Any, indent: int | str | None, ascii_only: bool) -> None:
    """What a JSON writer wrote is read back as a JSON reader would."""
    assert parse_marked(json.dumps(data, indent=indent, ensure_ascii=ascii_only), "x.json")[0] == data


def test_json_may_escape_what_lies_beyond_16_bits() -> None:
    """A surrogate pair and an escaped slash, which other writers use, are read."""
    assert parse_marked(r'["\ud83e\udd16 \/"]', "x.json")[0] == ["\N{ROBOT FACE} /"]


@given(JSON)
def test_every_value_has_a_mark_where_it_stands(data: Any) -> None:
    """The mark of a value points at its own text."""
    text = json.dumps(data, indent=1, ensure_ascii=False)
    lines = text.splitlines()
    read, marks = parse_marked(text, "x.json")

    def walk(value: Any, at: tuple[str | int, ...]) -> None:
        line, column = marks.values[at]
        assert json.dumps(value, ensure_ascii=False)[0] == lines[line - 1][column - 1]
        items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
        for key, below in items:
            walk(below, (*at, key))

    walk(read, ())


def test_scalars_follow_yaml_1_2() -> None:
    """What YAML 1.1 would turn into booleans, times and dates stays text; numbers are JSON's."""
    text = "[on, no, 12:30, 2026-01-01, '1', 1, 1e-3, -.5, true, null, ~, 0123]"
    assert parse_marked(text, "x")[0] == [
        "on", "no", "12:30", "2026-01-01", "1", 1, 1e-3, -0.5, True, None, None, 123,
    ]  # fmt: skip


def test_all_problems_at_once_each_in_its_place() -> None:
    """Unknown, missing and wrong values are all found, in the order of the file."""
    text = """\
nam: casa
solids:
  - shape: box
    size_m: -1
  - shape: bal
  - shape: ball
    radus_m: 1
  - 7
by_name:
  b: {shape: ball, radius_m: far}
"""
    assert problems(text) == [
        (1, 1, "missing-key"),
        (1, 1, "unknown-key"),
        (4, 13, "out-of-range"),
        (5, 12, "unknown-value"),
        (6, 5, "missing-key"),
        (7, 5, "unknown-key"),
        (8, 5, "wrong-type"),
        (10, 30, "wrong-type"),
    ]


def test_the_nearest_key_of_the_right_union_member_is_named() -> None:
    """A misspelt key is compared with the keys that its own kind of thing may have."""
    with pytest.raises(FileProblems, match=r"Did you mean 'radius_m'\? Known: radius_m, shape\.") as caught:
        validate_data(*parse_marked("name: a\nsolids: [{shape: ball, radus_m: 1}]", "x.yaml"), House)
    assert str(caught.value).startswith("x.yaml:2:10: ")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("name: a\nname: b\nname: c", [(2, 1, "duplicate-key"), (3, 1, "duplicate-key")]),
        ("name: [", [(1, 8, "syntax")]),
        ("a: b: c", [(1, 5, "syntax")]),
        ("", [(1, 1, "empty")]),
        ("# nothing\n", [(1, 1, "empty")]),
        ("--- 1\n--- 2\n", [(2, 1, "syntax")]),
        ("x: !!python/name:os.system ''", [(1, 4, "tag")]),
        ("x: *none", [(1, 4, "alias")]),
        ("x: &a [*a]", [(1, 8, "alias")]),
        ("? [1]\n: 2", [(1, 3, "syntax")]),
        ("a\x01b", [(1, 2, "syntax")]),
    ],
)
def test_broken_yaml_is_placed(text: str, expected: list[tuple[int, int, str]]) -> None:
    """Syntax, duplicate keys, tags, aliases to nothing: each is one problem with its place."""
    found = problems(text)
    assert [(line, code) for line, _, code in found] == [(line, code) for line, _, code in expected]


@given(st.text(max_size=200))
def test_no_text_gets_a_traceback(text: str) -> None:
    """Any text is data or a list of problems."""
    try:
        parse_marked(text, "x.yaml")
    except FileProblems as error:
        assert error.problems


def test_aliases_are_written_out() -> None:
    """An alias stands for a copy of what was anchored."""
    data, marks = parse_marked("a: &x {b: 1}\nc: *x\n", "x.yaml")
    assert data == {"a": {"b": 1}, "c": {"b": 1}}
    assert ("c", "b") in marks.values


@pytest.mark.parametrize(
    "text",
    [
        "[" * (MAX_DEPTH + 2) + "]" * (MAX_DEPTH + 2),
        "- 1\n" * (MAX_NODES + 1),
        "".join(f"k{i}: &k{i} [{', '.join([f'*k{i - 1}'] * 9) if i else '1'}]\n" for i in range(12)),
    ],
    ids=["deep", "long", "alias bomb"],
)
def test_what_would_eat_the_machine_is_refused(text: str) -> None:
    """Depth, number of values and aliases are bounded, and found out in time."""
    began = time.process_time()
    assert problems(text)[-1][2] in ("too-deep", "too-large")
    assert time.process_time() - began < 2.0


def test_a_huge_file_is_not_even_read(tmp_path: Path) -> None:
    """A file beyond the limit is refused by its size."""
    path = tmp_path / "huge.yaml"
    with path.open("wb") as file:
        file.truncate(10**9)
    with pytest.raises(FileProblems, match="larger than"):
        load_marked(path)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    """No file, a folder, and no text: one line each."""
    with pytest.raises(UserError, match=r"nothing\.yaml: no such file"):
        validate(tmp_path / "nothing.yaml", House)
    with pytest.raises(UserError, match="directory"):
        validate(tmp_path, House)
    (tmp_path / "latin.yaml").write_bytes(b"name: caf\xe9")
    with pytest.raises(FileProblems, match="not UTF-8"):
        validate(tmp_path / "latin.yaml", House)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ('{"a": 1,}', 1),
        ("{'a': 1}", 1),
        ('{"a": 1\n "b": 2}', 2),
        ('{"a": 1}\n// why', 2),
        ("a: 1\n", 1),
        ('{"a": [1,\n 2}', 2),
    ],
)
def test_a_json_file_holds_json(text: str, line: int) -> None:
    """What YAML would let pass is a problem in a file named .json, called by its name."""
    with pytest.raises(FileProblems, match="not valid JSON") as caught:
        parse_marked(text, "plan.json")
    assert [p.line for p in caught.value.problems] == [line]


def test_a_key_twice_in_json_is_a_problem() -> None:
    """Python's own reader would take the last one."""
    with pytest.raises(FileProblems, match="already on line 1"):
        parse_marked('{"a": 1,\n "a": 2}', "plan.json")


def test_a_missing_quote_is_told_where_it_is_missing() -> None:
    """The parser stumbles at the next quote; the problem that helps is at the first one."""
    text = 'a: "one\nb: 2\nc: 3\nd: 4\ne: "five"\n'
    with pytest.raises(FileProblems) as caught:
        parse_marked(text, "x.yaml")
    found = {p.line: p.message for p in caught.value.problems}
    assert found[1] == "this quoted text goes on to line 5; is its closing quote missing?"
    with pytest.raises(FileProblems, match="what begins here is not closed") as caught:
        parse_marked('a: 1\nb: "two\nc: 3\nd: 4\n', "x.yaml")
    assert 2 in [p.line for p in caught.value.problems]


@given(JSON, st.text("/~ab", min_size=1, max_size=4))
def test_pointers_find_what_locations_find(data: Any, key: str) -> None:
    """A JSON pointer, read by its standard, leads to the same value as the location."""
    read, marks = parse_marked(json.dumps({key: data}), "x.json")
    for location in marks.values:
        value = pointed = read
        for part in location:
            value = value[part]
        for part in pointer(location).split("/")[1:]:
            name = part.replace("~1", "/").replace("~0", "~")
            pointed = pointed[int(name) if isinstance(pointed, list) else name]
        assert pointed is value


def test_anchors_within_anchors_are_read_again() -> None:
    """An alias within an anchored value stands for its own value wherever that is read again."""
    text = "a: &a [1, &b {x: 2}, *b]\nc: &c [*a, *b]\nd: *c\n"
    inner = [1, {"x": 2}, {"x": 2}]
    data, marks = parse_marked(text, "x.yaml")
    assert data == {"a": inner, "c": [inner, {"x": 2}], "d": [inner, {"x": 2}]}
    assert marks.values[("d",)] == (3, 4)
    assert marks.values[("d", 1, "x")] == (1, 18)


def test_problems_are_bounded() -> None:
    """A file that is wrong all over gives a list that can still be read."""
    many = "".join(f"k{i}: 1\n" for i in range(20_000))
    assert len(problems(many)) == MAX_PROBLEMS
    assert len(problems("a: 1\n" * 20_000)) == MAX_PROBLEMS


def test_the_place_of_a_bad_byte_is_told(tmp_path: Path) -> None:
    """Line and column of what is not UTF-8."""
    path = tmp_path / "latin.yaml"
    path.write_bytes(b"a: 1\nname: caf\xe9\n")
    with pytest.raises(FileProblems, match="byte 0xe9") as caught:
        load_marked(path)
    assert [(p.line, p.column) for p in caught.value.problems] == [(2, 10)]


class Numbers(Record):
    """Numbers wherever a model may have them."""

    one: int = 0
    some: tuple[float, ...] = ()
    named: dict[str, int | None] = {}
    either: int | str = 0
    truth: bool = False


@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        ("one: true", "a whole number, not true"),
        ("one: '1'", "a whole number, not '1'"),
        ("some: [1, 2.5, false]", "a number, not false"),
        ("named: {a: 1, b: ~, c: true}", "a whole number, not true"),
    ],
)
def test_what_is_no_number_is_none(line: str, wanted: str) -> None:
    """Neither a truth value nor a quoted number, at any depth; where a text or a truth value may be, both are good."""
    data, marks = parse_marked(line, "t.yaml")
    with pytest.raises(FileProblems) as caught:
        validate_data(data, marks, Numbers)
    (problem,) = caught.value.problems
    assert problem.code == "wrong-type"
    assert problem.message == f"should be {wanted}"
    assert line[problem.column - 1 :].startswith(wanted.rpartition(" ")[2])
    good = "one: 1\nsome: [1, 2.5]\nnamed: {a: 1, b: ~}\neither: '1'\ntruth: true\n"
    assert validate_data(*parse_marked(good, "t.yaml"), Numbers).either == "1"


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        ("a:\n\tb: 1\n", (2, 1), "a tab cannot begin anything; indent with spaces"),
        ("r:\n  a: x\n  \tb: 1\n", (3, 3), "indent with spaces"),
        ("a: @home\n", (1, 4), "'@' cannot begin anything; put a text that begins with it into quotes"),
        ("a: [x, `y`]\n", (1, 8), "'`' cannot begin anything"),
        ("a: %x\n", (1, 4), "'%' cannot begin anything"),
        ("%x: a\n", (1, 3), "a line that begins with '%' is a directive"),
        ("a: *\n", (1, 5), "'*' begins an alias"),
        ("a: b: c\n", (1, 5), "a text with ': ' needs quotes"),
        ("a:\n  b c\n  d: 1\n", (3, 4), "or the line above lacks its ':'"),
        ("a:\n  - b: 1\n  c: 2\n", (3, 3), "keys of a list's item stand below its first one"),
        ("a:\n    - b: 1\n   - c: 2\n", (3, 4), "it is indented as no list or mapping above it"),
        ("a: 1\n\u00a0b: 1\n", (2, 1), "a no-break space (U+00A0), which YAML takes for a letter; type a plain space"),
        ("a:\u00a01\n", (1, 3), "a no-break space (U+00A0)"),
        ("a:\n  -\u00a01\n", (2, 4), "a no-break space (U+00A0)"),
        ("a: \u20091\n", (1, 4), "a thin space (U+2009)"),
        ("a: 1\n\u200bb: 1\n", (2, 1), "a zero width space (U+200B), which YAML takes for a letter; remove it"),
        ("a: 1\n\u00a0\nb: 1\n", (2, 1), "a no-break space (U+00A0)"),
    ],
)  # fmt: skip
def test_a_character_that_cannot_stand_there_is_named(text: str, place: tuple[int, int], words: str) -> None:
    """With what to write in its place, at its place."""
    with pytest.raises(FileProblems) as caught:
        parse_marked(text, "t.yaml")
    assert any((p.line, p.column) == place and words in p.message for p in caught.value.problems), str(caught.value)
    assert {p.code for p in caught.value.problems} == {"syntax"}


def test_a_no_break_space_within_a_text_is_text() -> None:
    """Where it separates nothing it is what somebody typed."""
    assert parse_marked("a: 5\u00a0kg\nb: '\u00a0'\n\"\u00a0\": 1\n", "t.yaml")[0] == {
        "a": "5\xa0kg",
        "b": "\xa0",
        "\xa0": 1,
    }


@pytest.mark.parametrize(
    ("written", "meters"),
    [
        ("4 in", "0.1016"),
        ("'4\"'", "0.1016"),
        ("12inches", "0.3048"),
        ("2 ft", "0.6096"),
        ("150mm", "0.15"),
        ("3 cm", "0.03"),
    ],
)
def test_a_length_with_a_unit_is_told_in_meters(written: str, meters: str) -> None:
    """Fields of meters take plain numbers; what has no unit that we know gets no such hint."""
    with pytest.raises(
        FileProblems, match=f"should be a number, not .*; lengths are in meters, without a unit: {meters}"
    ):
        validate_data(*parse_marked(f"shape: ball\nradius_m: {written}\n", "ball.yaml"), Ball)
    with pytest.raises(FileProblems) as caught:
        validate_data(*parse_marked("shape: ball\nradius_m: wide\n", "ball.yaml"), Ball)
    assert "meters" not in str(caught.value)


class Knob(Record):
    """Of the tests."""

    at: tuple[float, float, float]
    synset: Synset = "knob.n.01"
    motion: Annotated[str, Field(pattern=rf"^{IMPORT_PATH.pattern}$")] = "knobs:turn"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("at: [1, 2]", "t.yaml:1:5: should have 3 items, not 2 [wrong-type]"),
        ("at: []", "t.yaml:1:5: should have 3 items, not 0 [wrong-type]"),
        (
            "at: [1, 2, 3]\nsynset: knob",
            "t.yaml:2:9: should be a synset such as stapler.n.01, not 'knob' [invalid-value]",
        ),
        (
            "at: [1, 2, 3]\nmotion: knobs.turn",
            "t.yaml:2:9: should be an import path such as my_module:my_function, not 'knobs.turn' [invalid-value]",
        ),
    ],
)
def test_a_form_is_told_in_words(text: str, told: str) -> None:
    """Once: how many numbers a short list lacks, and an example in place of a pattern."""
    with pytest.raises(FileProblems) as caught:
        validate_data(*parse_marked(text, "t.yaml"), Knob)
    assert [str(one) for one in caught.value.problems] == [told]
