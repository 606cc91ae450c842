"""Trees, skills and tasks are found: ours, and a user's own before ours."""

from __future__ import annotations

from pathlib import Path

import pytest

from mpvi_bt.executive.trace.read import read_trace
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import UnknownName, UserError, with_article
from mpvi_bt.ground.marked_yaml import load_marked


def test_what_ships_is_found() -> None:
    """The task of the README is there, under its name."""
    assert "picking_up_trash" in paths.names("tasks")
    assert paths.find("tasks", "picking_up_trash").is_file()


def test_a_users_own_file_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file in a folder of MPVI_PATH wins over ours of the same name, and new names join ours."""
    (tmp_path / "tasks").mkdir()
    for name in ("picking_up_trash", "my_own"):
        (tmp_path / "tasks" / f"{name}.yaml").write_text("")
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    assert paths.find("tasks", "picking_up_trash").parent == tmp_path / "tasks"
    assert "my_own" in paths.names("tasks")


def test_a_missing_folder_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """MPVI_PATH that names nothing is an error of the user's, naming the folder."""
    monkeypatch.setenv("MPVI_PATH", "/nowhere")
    with pytest.raises(UserError, match="MPVI_PATH: /nowhere is not a folder"):
        paths.roots()


def test_a_folder_too_deep_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """MPVI_PATH that names trees/ itself would find nothing without a word."""
    (tmp_path / "trees").mkdir()
    monkeypatch.setenv("MPVI_PATH", str(tmp_path / "trees"))
    with pytest.raises(UserError, match=f"name the folder that holds trees/, which is {tmp_path}"):
        paths.roots()


def test_a_typing_error_names_the_nearest() -> None:
    """An unknown name is answered with the known one closest to it."""
    with pytest.raises(UnknownName, match=r"unknown task 'picking_up_trsh'\. Did you mean 'picking_up_trash'"):
        paths.find("tasks", "picking_up_trsh")


def test_a_path_is_taken_as_it_is(tmp_path: Path) -> None:
    """What looks like a path is one; a file that is not there is said so, not looked up as a name."""
    file = tmp_path / "tree.yaml"
    file.write_text("")
    assert paths.find_or_file("trees", str(file)) == file
    with pytest.raises(UserError, match=r"other\.yaml: there is no such file"):
        paths.find_or_file("trees", str(tmp_path / "other.yaml"))


def test_what_cannot_be_opened_has_no_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Folders, links that lead nowhere or round, and hidden files are no names; nor is what is too long for a file."""
    trees = tmp_path / "trees"
    (trees / "folder.yaml").mkdir(parents=True)
    (trees / "round.yaml").symlink_to(trees / "round.yaml")
    (trees / ".#mine.yaml").symlink_to("somebody@somewhere")
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    assert not {"folder", "round", ".#mine"} & set(paths.names("trees"))
    with pytest.raises(UserError, match="there is no such file"):
        paths.find_or_file("trees", "ä" * 190 + ".yaml")


def test_what_is_there_is_taken_whatever_its_suffix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file of any suffix or none, a pipe; a folder is told for one; a known name comes before a file of that name."""
    monkeypatch.chdir(tmp_path)
    for name in ("a.xml", "notes", "hello"):
        (tmp_path / name).touch()
    (tmp_path / "folder").mkdir()
    assert paths.find_or_file("trees", "a.xml") == Path("a.xml")
    assert paths.find_or_file("trees", "notes") == Path("notes")
    assert paths.find_or_file("trees", "/dev/stdin") == Path("/dev/stdin")
    assert paths.find_or_file("trees", "hello").parent.name == "trees"
    for folder in ("folder", "./folder", "."):
        with pytest.raises(UserError, match="is a folder; name a file in it"):
            paths.find_or_file("trees", folder)
    with pytest.raises(UserError, match=r"b\.xml: there is no such file"):
        paths.find_or_file("trees", "b.xml")
    with pytest.raises(UnknownName, match="unknown tree ''"):
        paths.find_or_file("trees", "")


def test_a_file_that_lacks_its_suffix_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The name of a tree in the folder one works in is nearly always meant as that file."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "greet.yaml").touch()
    with pytest.raises(UserError, match=r"unknown tree 'greet', but there is a file greet\.yaml"):
        paths.find_or_file("trees", "greet")


def test_a_file_that_is_not_there_is_called_what_it_would_be() -> None:
    """Each folder's files have a name of their own in messages: no letter is cut off a plural that has another form."""
    kinds = {"policies": "policy settings", "trees": "tree", "tasks/plans": "plan", "tasks/houses": "house"}
    for folder, kind in kinds.items():
        with pytest.raises(UnknownName, match=f"unknown {kind} 'nothing_like_it'"):
            paths.find(folder, "nothing_like_it")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("idle", "an idle"), ("object", "an object"), ("'int'", "an 'int'"), ("unit", "a unit"), ("urn", "an urn"),
        ("tree", "a tree"), ("utensil", "a utensil"), ("ashcan.n.01", "an ashcan.n.01"),
    ],
)  # fmt: skip
def test_words_get_their_article(words: str, said: str) -> None:
    """By how they begin, quoted or not."""
    assert with_article(words) == said


def test_a_file_of_nearly_that_name_is_named(tmp_path: Path) -> None:
    """Wherever a file is read that a user has named; a folder that is not there, or nothing near, adds nothing."""
    (tmp_path / "drink.yaml").write_text("x")
    for read in (lambda path: paths.find_or_file("trees", str(path)), load_marked, read_trace):
        with pytest.raises(UserError, match=r"Did you mean '.*/drink\.yaml'\?"):
            read(tmp_path / "drik.yaml")
        for nothing in ("of_another_name.yaml", "gone/drink.yaml"):
            with pytest.raises(UserError) as told:
                read(tmp_path / nothing)
            assert "Did you mean" not in str(told.value)
