"""The mistakes that newcomers make: each is one problem, where it is made, with the way out in its message."""

from __future__ import annotations

import json
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from mpvi_bt.apps.cli.check import check
from mpvi_bt.apps.cli.fmt import fmt
from mpvi_bt.apps.cli.listing import list_
from mpvi_bt.executive.behaviors.registry import node_types
from mpvi_bt.executive.tree import synonyms
from mpvi_bt.executive.tree.substitute import check_rules
from mpvi_bt.executive.tree.yaml_io import load_tree, parse_tree
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems, Problem, UserError
from mpvi_bt.ground.yaml_reader import read_yaml

GO_TO = paths.find("trees", "go_to")


def problems(root: str) -> list[Problem]:
    """Those of a tree with that root."""
    with pytest.raises(FileProblems) as caught:
        parse_tree("tree: t\nroot:\n" + "".join(f"  {line}\n" for line in root.splitlines()))
    return caught.value.problems


@pytest.mark.parametrize(
    ("root", "hint"),
    [
        ("sequence:\n  - wiat: 3", "a list of children stands under 'children:', not under 'sequence:' itself"),
        ("attempt:\n  wiat: 3", "a child stands under 'child:', not under 'attempt:' itself"),
        ("retry:\n  - wiat: 3", "a child stands under 'child:', not under 'retry:' itself"),
    ],
)
def test_children_right_under_the_kind_are_told_once_and_read(root: str, hint: str) -> None:
    """One problem says where they belong, and what is wrong in them is told too."""
    misplaced, inner = problems(root)
    assert (misplaced.line, misplaced.message) == (3, hint)
    assert (inner.line, inner.nearest) == (4, "wait")


def test_a_missing_key_says_what_it_may_be() -> None:
    """Choices are named, and of `memory` what each of them does; programs get them as `known`."""
    (memory,) = problems("sequence:\nchildren: [{succeed: }]")
    assert memory.message == (
        "missing key 'memory': true resumes at the child that was running, false asks every child again"
    )
    assert memory.known == ("true", "false")
    (policy,) = problems("parallel:\nchildren: [{succeed: }]")
    assert policy.message == "missing key 'policy': success_on_all or success_on_one"
    assert policy.known == ("success_on_all", "success_on_one")


@pytest.mark.parametrize(
    ("given", "kind"),
    [
        ("fallback", "selector"),
        ("ReactiveFallback", "selector"),
        ("Inverter", "invert"),
        ("RetryUntilSuccessful", "retry"),
        ("KeepRunningUntilFailure", "repeat"),
        ("ForceSuccess", "attempt"),
        ("if", "condition"),
        ("sleep", "wait"),
        ("UntilComplete", "until_complete"),
        ("timout", "timeout"),
    ],
)
def test_words_of_other_libraries_lead_to_ours(given: str, kind: str) -> None:
    """The nearest kind is the one that does the same, not the one that is spelled alike."""
    (problem,) = problems(f"{given}: x")
    assert problem.nearest == kind
    assert problem.message == f"unknown node {given!r}. Did you mean {kind!r}?"


def test_every_word_stands_for_one_kind_that_there_is() -> None:
    """The table of words has no kind that is gone, no word twice, and none that is a kind itself."""
    words = [word for words in synonyms._OTHERS.values() for word in words.split()]
    assert synonyms._OTHERS.keys() <= node_types().keys()
    assert len(set(words)) == len(words)
    assert not set(words) & node_types().keys()


def test_a_word_that_is_near_nothing_gets_all_kinds() -> None:
    """Composites first, none left out."""
    (problem,) = problems("xyzzy: 1")
    assert problem.message == f"unknown node 'xyzzy'. Known: {', '.join(node_types())}."


def test_too_few_children_are_counted_in_words() -> None:
    """Not "1 children"."""
    (problem,) = problems("sequence:\nmemory: true\nchildren: []")
    assert problem.message == "'sequence' needs a child or more, not none"


@pytest.mark.parametrize("value", ["", "  ", "a\nb"])
def test_a_text_parameter_is_one_line_with_something_in_it(value: str) -> None:
    """Anything else is refused where it is given, by its name, not where it is used."""
    with pytest.raises(UserError, match="parameter 'place' must be a line of text, not"):
        load_tree(GO_TO, arguments={"place": value})
    (problem,) = problems(f"subtree: go_to\narguments:\n  place: {value!r}".replace("'a\\nb'", '"a\\nb"'))
    assert (problem.line, problem.code) == (5, "parameter-type")
    default = "tree: t\nparameters:\n  a: {type: text, default: ''}\nroot:\n  say: $a\n"
    with pytest.raises(FileProblems, match="the default of a 'text' must be a line of text, not ''"):
        parse_tree(default)


def test_arguments_that_do_not_fit_name_the_file_that_was_called(tmp_path: Path) -> None:
    """A file beside the caller may stand before the one that was meant."""
    (tmp_path / "pick_up.yaml").write_text("tree: pick_up\nparameters: {what: text}\nroot:\n  say: $what\n")
    (tmp_path / "t.yaml").write_text("tree: t\nroot:\n  subtree: pick_up\n  arguments: {object: cup}\n")
    with pytest.raises(FileProblems) as caught:
        load_tree(tmp_path / "t.yaml")
    assert len(caught.value.problems) == 2
    assert all(str(tmp_path / "pick_up.yaml") in problem.message for problem in caught.value.problems)


def test_messages_have_the_words_of_yaml() -> None:
    """Nothing, true and a mapping, where Python says None, True and {...}."""
    with pytest.raises(FileProblems, match=r"should hold nothing, not true"):
        check_rules(*read_yaml('substitute:\n  - nodes: "*"\n    succeed: true\n', "r.yaml"))
    (problem,) = problems("timeout: {wait: 5}\nchild: {succeed: }")
    assert problem.message.endswith("not a mapping")


def test_names_of_trees_do_as_files(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """check and fmt take them as run does; a name that is near one gets the hint."""
    (tmp_path / "trees").mkdir()
    (tmp_path / "trees" / "get_cup.yaml").write_text("tree: get_cup\nroot: {say: hi}\n")
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    checked = CliRunner().invoke(check, ["get_cup"], standalone_mode=False)
    assert (checked.return_value, checked.stderr) == (0, "1 file: no problems\n")
    assert CliRunner().invoke(fmt, ["--check", "get_cup"], standalone_mode=False).return_value == 1
    for command in (check, fmt):
        done = CliRunner().invoke(command, ["get_cub"], standalone_mode=False)
        assert done.return_value == 2
        assert "unknown tree 'get_cub'. Did you mean 'get_cup'?" in done.output


@pytest.mark.parametrize("given", ["", "none.yaml", "no/such/file", "a\0b", "x" * 5000])
def test_what_is_not_there_ends_with_2(given: str) -> None:
    """As in every command; what else is named is checked all the same."""
    done = CliRunner().invoke(check, [given, str(GO_TO)], standalone_mode=False)
    assert done.return_value == 2
    assert done.stdout.count("[unreadable]") == 1
    assert done.stderr == "1 file: 1 problem\n"


@pytest.mark.parametrize("command", [check, fmt])
def test_a_folder_without_files_of_ours_says_so(command: click.Command, tmp_path: Path) -> None:
    """Not that it is a folder, which it may be."""
    (tmp_path / "readme.md").touch()
    done = CliRunner().invoke(command, [str(tmp_path)], standalone_mode=False)
    assert done.return_value == 2
    assert f"{tmp_path}: there is no .yaml, .yml, .json or .bddl file below it." in done.output


def test_the_standard_input_is_checked_and_shown() -> None:
    """Its lines stand below the problems, though it cannot be read again; `--json` has them too."""
    text = "tree: t\nroot:\n  wiat: 3\n"
    done = CliRunner().invoke(check, ["-"], input=text, standalone_mode=False)
    assert done.return_value == 1
    assert done.stdout.startswith("<stdin>:3:3: unknown node 'wiat'.")
    assert "    3 |   wiat: 3\n      |   ^^^^\n" in done.stdout
    assert '"source": "  wiat: 3"' in CliRunner().invoke(check, ["-", "--json"], input=text).stdout
    skill = paths.find("skills", "pick").read_text()
    assert CliRunner().invoke(check, ["-"], input=skill, standalone_mode=False).return_value == 0


def test_a_list_says_where_ones_own_files_lie(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """So that a file that hides a shipped one is seen; those that are shipped need no place."""
    (tmp_path / "trees").mkdir()
    own = tmp_path / "trees" / "fetch.yaml"
    own.write_text("tree: fetch\nabout: Mine.\nroot: {say: hi}\n")
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    lines = json.loads(CliRunner().invoke(list_, ["trees", "--json"], standalone_mode=False).stdout)
    assert lines["fetch"] == f"Mine. ({own})"
    assert not [line for name, line in lines.items() if name != "fetch" and str(paths.shipped()) in line]


def test_the_list_of_behaviors_names_their_choices() -> None:
    """Of what must be one of few words."""
    words = " ".join(CliRunner().invoke(list_, ["nodes"], standalone_mode=False).stdout.split())
    assert "(composite, memory: true or false)" in words
    assert "(composite, policy: success_on_all or success_on_one)" in words
    assert "(leaf, posture: travel)" in words


def test_one_step_is_no_steps() -> None:
    """A duration is told in the singular, however it was written."""
    assert {
        parse_tree(f"tree: t\nroot: {{wait: {n} {s}}}\n").root.label for n, s in (("1", "step"), ("1", "steps"))
    } == {"wait 1 step"}


def test_two_first_values_of_one_key_are_a_problem_unless_the_caller_has_its_own(tmp_path: Path) -> None:
    """Neither of two subtrees wins in silence; what their caller declares holds."""
    for name, value in (("one", 1), ("two", 2)):
        (tmp_path / f"{name}.yaml").write_text(f"tree: {name}\nblackboard: {{x: {value}}}\nroot: {{say: $x}}\n")
    both = "tree: t\nroot:\n  sequence: s\n  memory: true\n  children: [{subtree: one}, {subtree: two}]\n"
    (tmp_path / "t.yaml").write_text(both)
    with pytest.raises(FileProblems, match=r"t\.yaml:5:40: the key 'x' begins as 2 .*\[clashing-key\]"):
        load_tree(tmp_path / "t.yaml")
    (tmp_path / "t.yaml").write_text(both.replace("root:", "blackboard: {x: 3}\nroot:"))
    assert load_tree(tmp_path / "t.yaml").blackboard == {"x": 3}
