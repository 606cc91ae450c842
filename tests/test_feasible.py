"""Goals that cannot be met by the shapes of the things: found by check and by a run before it begins."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import mpvi_bt
from mpvi_bt.apps.cli.group import run as main
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems
from mpvi_bt.house.goals.formula import All, Exactly, Formula, Literal, Not, Pairs, Some, can_hold, holds
from mpvi_bt.house.instances.feasible import why_impossible
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.house.things.catalogue import CatalogueEntry, load_catalogue
from mpvi_bt.house.things.fitting_inside import not_inside


def made(name: str, family: str, mass_kg: float | None = 0.3, **shape: Any) -> CatalogueEntry:
    return CatalogueEntry(name=name, synset="box.n.01", family=family, shape=shape, mass_kg=mass_kg)


COLOR = (0.5, 0.5, 0.5)
BLOCK = made("block_10", "block", size_m=(0.1, 0.12, 0.14), color=COLOR)
STICK = made("stick", "block", size_m=(0.02, 0.02, 1.2), color=COLOR)
CRATE = made("crate", "open_box", size_m=(0.3, 0.3, 0.2), color=COLOR)
SMALL = made("small", "open_box", size_m=(0.09, 0.4, 0.2), color=COLOR)
BALL = made("ball", "ball", diameter_m=0.1, color=COLOR)
NAIL = made("nail_1", "nail", None, length_m=0.1, diameter_m=0.01)
LETTER_BOX = made(  # walls all around a volume, with a slot of 4 cm in its front
    "letter_box", "compound", color=COLOR, pieces=(
        *({"kind": "box", "at": (0, 0, z), "size_m": (0.4, 0.4, 0.01)} for z in (0.005, 0.395)),
        *({"kind": "box", "at": (0, y, 0.2), "size_m": (0.4, 0.01, 0.4)} for y in (-0.195, 0.195)),
        {"kind": "box", "at": (-0.195, 0, 0.2), "size_m": (0.01, 0.4, 0.4)},
        {"kind": "box", "at": (0.195, 0, 0.14), "size_m": (0.01, 0.4, 0.28)},
        {"kind": "box", "at": (0.195, 0, 0.36), "size_m": (0.01, 0.4, 0.08)},
    ),
)  # fmt: skip


def letter_box() -> Any:
    """What is hollow in the letter box is a volume."""
    from dataclasses import replace

    from mpvi_bt.ground.geometry.solids import box

    root = LETTER_BOX.description.root
    description = LETTER_BOX.description
    return replace(description, bodies=(replace(root, volumes=(box((0, 0, 0.2), (0.38, 0.38, 0.38)),)),))


def test_what_fits_through_no_opening_of_a_container_is_never_inside() -> None:
    """A narrow box and a slot refuse a block with the sizes of both; a stick that sticks out is inside all the same."""
    block, stick = BLOCK.description, STICK.description
    assert not_inside(block, CRATE.description) is None
    assert not_inside(stick, CRATE.description) is None
    assert "its opening is 0.07 x 0.38 m" in str(not_inside(block, SMALL.description))
    assert "smallest sides are 0.10 x 0.12 m" in str(not_inside(block, SMALL.description))
    assert "its opening is 0.0" in str(not_inside(block, letter_box()))
    assert not_inside(stick, letter_box()) is None
    assert "no volume" in str(not_inside(stick, BLOCK.description))


GOALS = [
    ("inside", "block_10", "crate", None),
    ("inside", "block_10", "small", "'small': its opening is"),
    ("inside", "block_10", "ball", "'ball': it has no volume"),
    ("ontop", "block_10", "crate", None),
    ("ontop", "block_10", "ball", "'ball' has no level face"),
    ("ontop", "block_10", "nail_1", "'nail_1' has no level face"),
    ("contains", "block_10", "water", "'block_10' has no volume"),
    ("toggled_on", "block_10", None, "'block_10' has no switch"),
    ("open", "crate", None, "'crate' has nothing that opens"),
    ("attached", "crate", "nail_1", "no mount of 'crate' fits one of 'nail_1'"),
]


@pytest.mark.parametrize(("predicate", "first", "second", "said"), GOALS)
def test_a_literal_that_no_shape_allows_is_told_with_its_cause(
    predicate: str, first: str, second: str | None, said: str | None
) -> None:
    """And what is wanted false, or has an alternative that can be met, is none of it."""
    entries = {entry.name: entry for entry in (BLOCK, STICK, CRATE, SMALL, BALL, NAIL)}
    literal = Literal(predicate, (first, second) if second else (first,))
    cause = why_impossible(All((literal,)), entries)
    assert (cause is None) if said is None else (cause is not None and said in cause)
    assert why_impossible(Not(literal), entries) is None
    assert why_impossible(Some((literal, Literal("inside", ("stick", "crate")))), entries) is None


NAMES = "abcd"
FORMULAS: st.SearchStrategy[Formula] = st.recursive(
    st.sampled_from([Literal("p", (name,)) for name in NAMES]),
    lambda inner: st.one_of(
        inner.map(Not),
        st.lists(inner, min_size=1, max_size=3).map(lambda parts: All(tuple(parts))),
        st.lists(inner, min_size=1, max_size=3).map(lambda parts: Some(tuple(parts))),
        st.tuples(st.integers(0, 3), st.lists(inner, min_size=1, max_size=3)).map(lambda p: Exactly(p[0], tuple(p[1]))),
        st.tuples(st.integers(0, 2), st.lists(st.tuples(inner, inner), min_size=1, max_size=2)).map(
            lambda p: Pairs(p[0], tuple(p[1]))
        ),
    ),
    max_leaves=6,
)


@given(FORMULAS, st.sets(st.sampled_from(NAMES)), st.sets(st.sampled_from(NAMES)))
def test_a_goal_that_holds_somewhere_is_never_called_impossible(
    formula: Formula, possible: set[str], true: set[str]
) -> None:
    """Whatever the connectives: in a world where only possible literals are true, a formula that holds can hold."""
    if holds(formula, lambda literal: literal.args[0] in possible & true):
        assert can_hold(formula, lambda literal: literal.args[0] in possible)


def test_no_task_that_ships_is_called_impossible() -> None:
    """All fifty have plans, and most were played to their end."""
    for name in paths.names("tasks"):
        load_task(name)


def test_check_and_runs_refuse_a_task_whose_goal_cannot_be_met(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A bin that is narrower than the can: told once by check, and by a dry run, with the sizes of both."""
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert main(["new", "task", "toss"]) == 0
    assert main(["new", "object", "tiny_bin", "--like", "trash_can", "--no-picture"]) == 0
    bin_ = tmp_path / "tasks/catalogues/tiny_bin.yaml"
    bin_.write_text(re.sub(r"size_m: .*", "size_m: [0.08, 0.06, 0.3]", bin_.read_text()))
    task = tmp_path / "tasks/toss.yaml"
    task.write_text(task.read_text().replace("ashcan.n.01: trash_can", "ashcan.n.01: tiny_bin"))
    with pytest.raises(
        FileProblems, match=r"the goal cannot be met: inside\(.*'tiny_bin': its opening is 0.05 x 0.07 m"
    ):
        load_task("toss")
    capsys.readouterr()
    for command in (["check", "."], ["run", "toss", "--dry", "--no-watch"]):
        assert main(command) != 0
        captured = capsys.readouterr()
        assert (captured.out + captured.err).count("the goal cannot be met") == 1


def test_a_problem_of_a_file_that_others_name_is_told_once_as_it_was_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A catalogue that a task is checked against is read twice, once by its full path."""
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert main(["new", "task", "toss"]) == 0
    assert main(["new", "object", "my_bin", "--like", "trash_can", "--no-picture"]) == 0
    bin_ = tmp_path / "tasks/catalogues/my_bin.yaml"
    bin_.write_text(bin_.read_text() + "    volumes: []\n")
    (problem,) = mpvi_bt.check("tasks")
    assert problem.file == "tasks/catalogues/my_bin.yaml"


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("    volumes: []", "no parameter of 'trash_can'; under `shape:` these families take it: mesh"),
        ("    size_m: [1, 1, 1]", "'size_m' belongs under `shape:`, with the other parameters of 'trash_can'"),
        ("      mass_kg: 1", "'mass_kg' belongs beside `shape:`, not under it"),
        ("    shapes: 1", "unknown key 'shapes'. Did you mean 'shape'?"),
    ],
)
def test_a_key_that_stands_beside_its_place_is_told_its_place(
    line: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a shape's parameters and of an entry's keys alike."""
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert main(["new", "object", "my_bin", "--like", "trash_can", "--no-picture"]) == 0
    bin_ = tmp_path / "tasks/catalogues/my_bin.yaml"
    text = bin_.read_text()
    shape = "    shape:\n"
    bin_.write_text(text.replace(shape, f"{shape}{line}\n") if line.startswith("      ") else f"{text}{line}\n")
    assert said in mpvi_bt.check("tasks")[0].message


def test_a_new_object_says_which_extent_is_its_height(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In words, with the axis of each."""
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert main(["new", "object", "my_can", "--like", "can_of_soda", "--no-picture"]) == 0
    height = load_catalogue()["my_can"].description.extent()[1, 2]
    assert f"{height:.3f} m high (z)" in capsys.readouterr().out


@pytest.mark.render
def test_a_new_object_is_drawn_beside_its_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The picture shows the thing, and nothing that is there is written over."""
    import cv2

    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tasks/catalogues").mkdir(parents=True)
    (tmp_path / "tasks/catalogues/my_can.png").write_bytes(b"mine")
    for name in ("my_can", "my_bin"):
        assert main(["new", "object", name, "--like", "trash_can"]) == 0
    assert (tmp_path / "tasks/catalogues/my_can.png").read_bytes() == b"mine"
    picture = cv2.imread(str(tmp_path / "tasks/catalogues/my_bin.png"))
    assert picture is not None
    assert picture.std() > 5
