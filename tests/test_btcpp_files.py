"""Files of BehaviorTree.CPP as other programs save them: which tree is run, and in which encoding they are."""

from __future__ import annotations

import codecs
from pathlib import Path

import pytest
from click.testing import CliRunner

from mpvi_bt.apps.cli.convert import convert
from mpvi_bt.executive.btcpp.encoding import read_xml
from mpvi_bt.executive.btcpp.importing import from_xml
from mpvi_bt.executive.tree.yaml_io import load_tree
from mpvi_bt.ground.errors import FileProblems, UnknownName, UserError


def calling(**trees: str) -> str:
    """A file of trees, each of which calls the trees of the IDs named, separated by spaces."""
    made = (
        f'<BehaviorTree ID="{name}"><Sequence><AlwaysSuccess/>'
        + "".join(f'<SubTree ID="{called}" _autoremap="true"/>' for called in calls.split())
        + "</Sequence></BehaviorTree>"
        for name, calls in trees.items()
    )
    return f'<root BTCPP_format="4">{"".join(made)}</root>'


def test_the_only_tree_that_no_other_calls_is_run() -> None:
    """Groot2 saves no main_tree_to_execute; the tree that was taken is told."""
    imported = from_xml(calling(Fetch="", Main="Fetch Say", Say=""))
    assert imported.main.name == "Main"
    told = next(p for p in imported.warnings if p.code == "btcpp-main-tree")
    assert "'Main' is taken, the only tree that no other calls" in told.message


def test_several_outermost_trees_are_listed_and_one_can_be_named() -> None:
    """Which of them is meant is not guessed; `main_tree` names it, and goes before what the file says."""
    with pytest.raises(FileProblems, match="2 that no other calls: 'A', 'B'\\. Give --main-tree"):
        from_xml(calling(A="C", B="C", C=""))
    with pytest.raises(FileProblems, match="2, each called by another: 'A', 'B'"):
        from_xml(calling(A="B", B="A"))
    named = calling(A="C", B="C", C="").replace("<root ", '<root main_tree_to_execute="A" ')
    assert from_xml(named).main.name == "A"
    for name in ("B", "C"):
        assert from_xml(named, main_tree=name).main.name == name
    with pytest.raises(UnknownName, match="unknown tree 'a'\\. Known: A, B, C"):
        from_xml(named, main_tree="a")


_SAID = '<root BTCPP_format="4"><BehaviorTree ID="t"><Say text="tasse à café"/></BehaviorTree></root>'


@pytest.mark.parametrize(
    ("head", "codec"),
    [
        ("", "utf-8"),
        ("", "utf-8-sig"),
        ('<?xml version="1.0" encoding="UTF-8"?>\r\n', "utf-8-sig"),
        ("<?xml version='1.0' encoding='ISO-8859-1'?>", "latin-1"),
        ('<?xml version="1.0" encoding="windows-1252" standalone="yes"?>', "cp1252"),
        ('<?xml version="1.0" encoding="UTF-16"?>', "utf-16"),
        ('<?xml version="1.0" encoding="UTF-16"?>', "utf-16-be"),
        ('<?xml version="1.0" encoding="UTF-32"?>', "utf-32"),
    ],
)
def test_a_file_is_read_in_the_encoding_that_it_declares(tmp_path: Path, head: str, codec: str) -> None:
    """By its byte order mark, its declaration, or as UTF-8; what is written then is UTF-8."""
    given = (head + _SAID).encode(codec)
    (tmp_path / "t.xml").write_bytes(codecs.BOM_UTF16_BE + given if codec == "utf-16-be" else given)
    assert CliRunner().invoke(convert, [str(tmp_path / "t.xml"), str(tmp_path / "t.yaml")]).exit_code == 0
    assert load_tree(tmp_path / "t.yaml").root.label == 'say "tasse à café"'


@pytest.mark.parametrize(
    ("content", "column", "words"),
    [
        (_SAID.encode("latin-1"), _SAID.index("à") + 1, "not UTF-8 text"),
        (b"<?xml version='1.0' encoding='ascii'?>" + _SAID.encode(), 39 + _SAID.index("à"), "not ASCII text"),
        (b'<?xml version="1.0" encoding="UTF-16"?>' + _SAID.encode(), 1, "one byte a character"),
        (b'<?xml version="1.0" encoding="klingon"?>' + _SAID.encode(), 1, "'klingon' is unknown"),
        (b'<?xml version="1.0" encoding="hex"?>' + _SAID.encode(), 1, "'hex' is unknown"),
    ],
)
def test_what_is_not_in_its_encoding_is_refused_at_its_place(
    tmp_path: Path, content: bytes, column: int, words: str
) -> None:
    """A wrong declaration is no traceback and gives no wrong letters."""
    (tmp_path / "t.xml").write_bytes(content)
    with pytest.raises(FileProblems, match=words) as caught:
        read_xml(tmp_path / "t.xml")
    assert [(p.line, p.column, p.code) for p in caught.value.problems] == [(1, column, "encoding")]


def test_a_folder_that_is_not_there_is_made(tmp_path: Path) -> None:
    """Where it cannot be, that is told as a user's mistake."""
    run = CliRunner()
    out = tmp_path / "new" / "trees" / "hello.xml"
    assert run.invoke(convert, ["hello", str(out)]).exit_code == 0
    assert run.invoke(convert, [str(out), str(tmp_path / "back" / "hello.yaml")]).exit_code == 0
    assert load_tree(tmp_path / "back" / "hello.yaml").name == "hello"
    refused = run.invoke(convert, ["hello", str(out / "below" / "hello.xml")]).exception
    assert isinstance(refused, UserError)
    assert "cannot be written" in str(refused)


def test_the_tree_to_run_is_named_only_of_xml(tmp_path: Path) -> None:
    """A tree of ours is one tree."""
    (tmp_path / "t.xml").write_text(calling(A="C", B="C", C=""))
    run = CliRunner()
    assert run.invoke(convert, [str(tmp_path / "t.xml"), str(tmp_path / "t.yaml"), "--main-tree", "B"]).exit_code == 0
    assert load_tree(tmp_path / "t.yaml").name == "B"
    assert isinstance(run.invoke(convert, ["hello", "--main-tree", "B"]).exception, UserError)
