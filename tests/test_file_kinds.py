"""A file of one kind where another is due is told for what it is, with the command that takes it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from mpvi_bt.apps.cli import COMMANDS
from mpvi_bt.apps.cli.check import check
from mpvi_bt.executive.plan.schema import load_plan
from mpvi_bt.executive.plan.skills import load_skill
from mpvi_bt.executive.tree.substitute import load_rules
from mpvi_bt.executive.tree.yaml_io import load_tree
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import FileProblems
from mpvi_bt.ground.file_kinds import KINDS
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.runs.choices.methods import load_method
from mpvi_bt.runs.episode.result import Result
from mpvi_bt.runs.episode.saved_episode import SavedEpisode, load_saved
from mpvi_bt.runs.suite.suites import load_suite

ROOT = paths.shipped()
RULES = 'substitute:\n  - nodes: "*/say"\n    succeed:\n'
FILES: dict[str, tuple[str, str]] = {  # name: its text, and what takes it
    "tree.yaml": ((ROOT / "trees/hello.yaml").read_text(), "mpvi run --tree FILE"),
    "plan.json": ((ROOT / "tasks/plans/picking_up_trash.json").read_text(), "mpvi compile FILE"),
    "pick.yaml": ((ROOT / "skills/pick.yaml").read_text(), "a folder skills/"),
    "task.yaml": ((ROOT / "tasks/picking_up_trash.yaml").read_text(), "mpvi run FILE"),
    "suite.yaml": ("tasks: [picking_up_trash]\ninstances: [0]\n", "mpvi suite run FILE"),
    "method.yaml": ((ROOT / "tasks/methods/mpvi.yaml").read_text(), "mpvi run --method FILE"),
    "rules.yaml": (RULES, "mpvi run --substitute FILE"),
    "run.saved.json": (json.dumps(dict.fromkeys(SavedEpisode.model_fields, 1)), "mpvi run --resume FILE"),
    "result.json": (json.dumps(dict.fromkeys(Result.model_fields, 1)), "mpvi suite"),
    "run.trace.jsonl": ('{"trace": 1, "tree": {}}\n{"tick": 1}\n', "mpvi replay FILE` and `mpvi explain FILE"),
    "robot.urdf": ('<?xml version="1.0"?>\n<!-- of CAD -->\n<robot name="r"/>\n', "mpvi new robot NAME --urdf FILE"),
    "tree.xml": ('<?xml version="1.0"?>\n<root BTCPP_format="4"/>\n', "mpvi convert FILE OUT.yaml"),
}
LOADERS: dict[str, Callable[[str], Any]] = {
    "tree.yaml": load_tree,
    "plan.json": load_plan,
    "pick.yaml": load_skill,
    "task.yaml": load_task,
    "suite.yaml": load_suite,
    "method.yaml": load_method,
    "rules.yaml": load_rules,
}


@pytest.mark.parametrize("due", LOADERS)
def test_every_other_kind_is_recognized(tmp_path: Path, due: str) -> None:
    """One problem says what the file is and what takes it; the right kind loads."""
    for name, (text, use) in FILES.items():
        path = tmp_path / name
        path.write_text(text)
        if name == due:
            LOADERS[due](str(path))
        elif not (name.endswith((".xml", ".jsonl")) and due in ("task.yaml", "suite.yaml")):  # these take no such names
            with pytest.raises(FileProblems) as caught:
                LOADERS[due](str(path))
            (problem,) = caught.value.problems
            assert problem.code == "wrong-kind", name
            assert use in problem.message


def test_only_a_saved_run_is_gone_on_with(tmp_path: Path) -> None:
    """What is given to --resume is told for what it is."""
    path = tmp_path / "tree.yaml"
    path.write_text(FILES["tree.yaml"][0])
    with pytest.raises(FileProblems, match="this is a tree, not a saved run; it is for `mpvi run --tree FILE`"):
        load_saved(path)


@pytest.mark.parametrize("name", FILES)
def test_check_says_what_it_cannot_check(tmp_path: Path, name: str) -> None:
    """A file that mpvi_bt wrote, or XML, is told by name; found in a folder, what mpvi_bt wrote is passed over."""
    text, use = FILES[name]
    path = tmp_path / name
    path.write_text(text)
    named = CliRunner().invoke(check, [str(path)], standalone_mode=False)
    assert (named.return_value, f"{use}" in named.stdout) == ((0, False) if name in LOADERS else (1, True))
    found = CliRunner().invoke(check, [str(tmp_path)], standalone_mode=False)
    assert "wrong-kind" not in found.stdout


def test_what_takes_a_file_is_there() -> None:
    """Every command that a kind names is one, with such an option."""
    for kind in KINDS:
        if kind.use.startswith("mpvi"):
            _, command, *rest = kind.use.split()
            module, function = COMMANDS[command][0].split(":")
            loaded = getattr(__import__(module, fromlist=[function]), function)
            options = {o for p in loaded.params for o in p.opts}
            assert {word for word in rest if word.startswith("--")} <= options
            assert all(re.fullmatch(r"--[a-z]+|FILE|run", word) for word in rest)


def test_a_misspelled_key_is_told_where_no_key_is_known(tmp_path: Path) -> None:
    """At its place, with the nearest of any kind."""
    path = tmp_path / "rules.yaml"
    path.write_text(RULES.replace("substitute:", "about: a slip\nsubsitute:"))
    answer = CliRunner().invoke(check, [str(path)])
    assert (
        "rules.yaml:2:1: unknown key 'subsitute', in a file of no known kind. Did you mean 'substitute'?"
        in answer.output
    )
