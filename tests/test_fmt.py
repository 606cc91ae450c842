"""`mpvi fmt`: canonical form that keeps every comment and every meaning."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner, Result
from hypothesis import assume, given
from hypothesis import strategies as st

from mpvi_bt.apps.cli.fmt import fmt
from mpvi_bt.executive.tree.comments import comments_of, texts_of
from mpvi_bt.executive.tree.formatting import formatted
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.executive.tree.yaml_io import dump_tree, parse_tree
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems
from mpvi_bt.ground.marked_yaml import parse_marked
from tests.tree_strategies import trees

TREES = sorted((paths.shipped() / "trees").glob("*.yaml"))

UGLY = """\
# head 1

# head 2
root:   # the root
  # about the sequence
  sequence: x   # name


  memory:   true
      # deeper than memory
  children: # list
       # before a
     - navigate: a # eol a
       room: kitchen
       # after room
     # about to come

     - # dash
       timeout: 5.0
       child: {navigate: b, # flow
           # own
           room: "kitchen" } # closing
          # - navigate: c
     - until_complete:
       children:
         - manipulate: "pick up the cup"
           # last of inner
         - check_complete: >-
             folded
             text
           # last
     # last of children
# end of root
tree: t # name of tree
instruction: |  # block
  two

  lines # no comment
# above parameters
parameters:
  x: {type: text}   # x
  y:
    about: hm  # why
    type: integer
    # default
    default: 3

# tail
"""

CANONICAL = """\
# head 1

# head 2
# end of root
tree: t  # name of tree
instruction: |-  # block
  two

  lines # no comment
# above parameters
parameters:
  x: text  # x
  # default
  y: {type: integer, default: 3, about: hm}  # why

# tail
root:  # the root
  # about the sequence
  sequence: x  # name

  memory: true
  # deeper than memory
  children:  # list
    # before a
    - navigate: a  # eol a
      room: kitchen
      # after room
    # about to come

    - timeout: 5  # dash
      child:
        navigate: b  # flow
        # own
        room: kitchen  # closing
      # - navigate: c
    - until_complete:
      children:
        - manipulate: pick up the cup
          # last of inner
        - check_complete: folded text
          # last
    # last of children
"""


def run(*args: str | Path, text: str | None = None) -> Result:
    """`mpvi fmt`."""
    return CliRunner().invoke(fmt, list(map(str, args)), input=text, standalone_mode=False)


def test_comments_stay_where_they_belong() -> None:
    """Above, beside and after what they are about; deeper ones with what came before; those of lost keys nearby."""
    assert formatted(UGLY, "t.yaml") == CANONICAL
    assert formatted(CANONICAL, "t.yaml") == CANONICAL


@pytest.mark.parametrize("path", TREES, ids=lambda p: p.stem)
def test_shipped_trees_are_in_canonical_form(path: Path) -> None:
    """`mpvi fmt` has nothing to do there."""
    assert formatted(path.read_text(), str(path)) == path.read_text()


@given(tree=trees)
def test_what_is_dumped_is_in_canonical_form(tree: TreeSpec) -> None:
    """Writing a tree and formatting a file agree on the form."""
    text = dump_tree(tree)
    assert formatted(text, "t.yaml") == text


@given(tree=trees, data=st.data())
def test_every_comment_survives_and_nothing_else_changes(tree: TreeSpec, data: st.DataObject) -> None:
    """Whatever the style of a file and wherever its comments: the same tree, the same comments, and once is enough."""
    plain = parse_marked(dump_tree(tree), "t.yaml")[0]
    dump = data.draw(
        st.sampled_from(
            [
                lambda d: dump_tree(tree),
                lambda d: json.dumps(d, indent=3, ensure_ascii=False),
                lambda d: yaml.safe_dump(d, sort_keys=False, indent=4, width=30, allow_unicode=True),
                lambda d: yaml.safe_dump(dict(reversed(d.items())), sort_keys=False, default_style='"'),
            ]
        )
    )
    lines = dump(plain).splitlines()
    for i in range(data.draw(st.integers(0, 6))):
        at = data.draw(st.integers(0, len(lines)))
        comment = f"# {i} " + data.draw(st.sampled_from(["why", "'", '"', "- a: b", "#", "{", "", "\N{SNOWMAN}"]))
        if data.draw(st.booleans()) or at == len(lines):
            lines.insert(at, " " * data.draw(st.integers(0, 12)) + comment)
        else:
            lines[at] += " " * data.draw(st.integers(1, 3)) + comment
        if data.draw(st.booleans()):
            lines.insert(at, "")
    text = "\n".join(lines) + "\n"
    try:
        assume(parse_marked(text, "t.yaml")[0] == parse_marked(dump(plain), "t.yaml")[0])  # not within a text
        before = parse_tree(text, "t.yaml")
    except FileProblems:
        assume(False)
    result = formatted(text, "t.yaml")
    assert parse_tree(result, "t.yaml") == before
    assert Counter(texts_of(result)) == Counter(texts_of(text))
    assert formatted(result, "t.yaml") == result


def test_a_hash_within_a_text_is_no_comment() -> None:
    """Quoted, folded and plain texts keep theirs."""
    text = "tree: 'a # b'\nabout: c#d\ninstruction: >\n  # e\n  f # g\nroot: {say: \"# h\"} # i\n"
    assert texts_of(text) == ["# i"]
    assert [c.at for c in comments_of(text, parse_marked(text, "t")[1])] == [("root", "say")]


def test_aliases_are_written_out() -> None:
    """What an anchor names stands twice; its comments once."""
    text = "tree: t\nroot:\n  sequence:\n  memory: true\n  children:\n  - &a\n    say: hi  # once\n  - *a  # again\n"
    assert formatted(text, "t") == (
        "tree: t\nroot:\n  sequence:\n  memory: true\n  children:\n    - say: hi  # once\n    - say: hi  # again\n"
    )


def test_files_are_changed_in_place(tmp_path: Path) -> None:
    """Those that need it, and only those; other files of a folder are left alone."""
    bad, good = tmp_path / "a.yaml", tmp_path / "b.yaml"
    bad.write_text(UGLY)
    good.write_text(CANONICAL)
    (tmp_path / "c.json").write_text('{"tree": "t", "root": {"say": "hi"}}')
    (tmp_path / "d.yaml").write_text("hello:   1\n")
    before = good.stat().st_mtime_ns
    done = run(tmp_path)
    assert (done.return_value, done.stdout, bad.read_text()) == (0, "", CANONICAL)
    assert done.stderr == f"changed {bad}\n2 trees, 1 changed\n"
    assert good.stat().st_mtime_ns == before
    assert (tmp_path / "d.yaml").read_text() == "hello:   1\n"


def test_line_ends_are_those_of_unix(tmp_path: Path) -> None:
    """A file from Windows is changed for its line ends and its byte order mark alone."""
    path = tmp_path / "t.yaml"
    path.write_bytes(("\ufeff" + CANONICAL).replace("\n", "\r\n").encode())
    assert run("--check", path).return_value == 1
    assert run(path).return_value == 0
    assert path.read_bytes() == CANONICAL.encode()


def test_check_and_diff_write_nothing(tmp_path: Path) -> None:
    """--check ends with 1 if a file would change; --diff shows how."""
    path = tmp_path / "t.yaml"
    path.write_text(UGLY)
    assert run("--check", path).return_value == 1
    shown = run("--diff", path)
    assert (shown.return_value, path.read_text()) == (0, UGLY)
    assert f"--- {path}\n" in shown.stdout
    assert "\n+  memory: true\n" in shown.stdout
    assert json.loads(run("--check", "--json", path).stdout) == {"changed": [str(path)], "files": 1, "problems": []}
    path.write_text(CANONICAL)
    assert run("--check", path).return_value == 0
    assert run("--diff", path).stdout == ""


def test_standard_input_goes_to_standard_output() -> None:
    """For editors: "-" reads a tree and writes its canonical form, unchanged if it is that."""
    assert run("-", text=UGLY).stdout == CANONICAL
    assert run("-", text=CANONICAL).stdout == CANONICAL


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("tree: t\nroot:\n  navigat:   x\n", "unknown-node"),
        ("tree:   t\nroot: [\n", "syntax"),
        ("name:   pick\nphrases: []\n", "not-a-tree"),
        ("", "empty"),
    ],
)
def test_a_file_with_problems_is_not_touched(tmp_path: Path, text: str, code: str) -> None:
    """It is left as it is, its problems are told, and the exit code is 2."""
    path = tmp_path / "t.yaml"
    path.write_text(text)
    done = run(path)
    assert (done.return_value, path.read_text()) == (2, text)
    assert f"[{code}]" in done.stderr
    assert [p["code"] for p in json.loads(run("--json", path).stdout)["problems"]] == [code]


def test_what_is_no_file_is_told(tmp_path: Path) -> None:
    """One line, and exit code 2."""
    done = run(tmp_path / "none.yaml")
    assert (done.return_value, done.stderr.count("\n")) == (2, 2)
