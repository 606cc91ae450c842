"""The executive, without the wings above it: `hands/` and `house/` are deleted, and people go on making trees."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from mpvi_bt.runs.choices.named_task import task_named
from tests.rooms import PACKAGE

POLICY = """\
import numpy as np

class Still:
    name, cameras = "still", ()
    def reset(self): ...
    def infer(self, observation): return np.zeros((1, 23))
"""
PLANNER = """\
from mpvi_bt.executive.plan.planners import Planned
from mpvi_bt.executive.plan.schema import Plan

class Mine:
    name = "mine"
    def ask(self, task_name, instruction, history=None):
        segment = {"type": "navigation", "description": "go to the table", "target": "table",
                   "completion_criterion": "the robot is at the table"}
        return Planned(Plan(task_name="instruction", instruction=instruction, segments=[segment]))
"""
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A checkout whose package has neither hands nor a house."""
    root = tmp_path_factory.mktemp("wings")
    shutil.copytree(PACKAGE, root / "mpvi_bt", ignore=shutil.ignore_patterns("__pycache__", "hands", "house"))
    for folder in ("trees", "skills", "tasks", "policies", "robots", "bridges"):
        (root / folder).symlink_to(PACKAGE.parent / folder)
    (root / "mine.py").write_text(POLICY + PLANNER)
    return root


def _environment(root: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(root), "COLUMNS": "80"}


def mpvi(root: Path, *words: str) -> str:
    """What a command answers. Asserts that it succeeds."""
    command = [sys.executable, "-m", "mpvi_bt.apps.cli", *words]
    done = subprocess.run(
        command, cwd=root, env=_environment(root), capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@contextmanager
def serving(root: Path, pattern: str, *words: str) -> Iterator[re.Match[str]]:
    """A command that serves, with what it says of where it does."""
    command = [sys.executable, "-m", "mpvi_bt.apps.cli", *words]
    process = subprocess.Popen(command, cwd=root, env=_environment(root), stderr=subprocess.PIPE, text=True)
    try:
        assert process.stderr is not None
        said = []
        for line in process.stderr:
            said.append(line)
            if found := re.search(pattern, line):
                yield found
                break
        else:
            pytest.fail("".join(said))
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)


def test_the_wings_are_not_there(root: Path) -> None:
    """Or the laws below would say nothing."""
    code = "import importlib.util as u; print([bool(u.find_spec(f'mpvi_bt.{w}')) for w in ('hands', 'house', 'runs')])"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=root, env=_environment(root), capture_output=True, text=True, check=True
    )
    assert done.stdout == "[False, False, True]\n"


def test_trees_skills_and_plans_are_checked(root: Path) -> None:
    """`mpvi check`, of all that ship."""
    files = [str(path.relative_to(root)) for path in sorted([*root.glob("trees/*.yaml"), *root.glob("skills/*.yaml")])]
    assert json.loads(mpvi(root, "check", "--json", *files, "tasks/plans/picking_up_trash.json"))["problems"] == []


def test_a_plan_is_compiled(root: Path) -> None:
    """`mpvi compile`, and what it makes passes the check."""
    (root / "made.yaml").write_text(mpvi(root, "compile", "tasks/plans/picking_up_trash.json"))
    assert json.loads(mpvi(root, "check", "--json", "made.yaml"))["problems"] == []


def test_an_instruction_is_planned(root: Path) -> None:
    """`mpvi plan`, with a planner of one's own."""
    plan = json.loads(mpvi(root, "plan", "go to the table", "--planner", "mine:Mine"))
    assert plan["segments"][0]["target"] == "table"


def test_a_tree_runs_dry(root: Path) -> None:
    """`mpvi run --dry`."""
    assert "SUCCESS" in mpvi(root, "run", "--dry", "--tree", "evening_round", "--no-watch")


def test_a_tree_is_converted(root: Path) -> None:
    """`mpvi convert`, to BehaviorTree.CPP's XML."""
    assert mpvi(root, "convert", "evening_round").lstrip().startswith("<")


def test_a_tree_is_edited(root: Path) -> None:
    """`mpvi edit`: the page comes."""
    shutil.copy(PACKAGE.parent / "trees" / "hello.yaml", root / "hello.yaml")
    with serving(root, r"(http://\S+?);?\s", "edit", "hello.yaml", "--serve", "0") as found:
        assert "hello" in urllib.request.urlopen(found[1], timeout=30).read().decode()


def test_agents_are_served(root: Path) -> None:
    """`mpvi mcp`: a client checks a tree."""
    tree = "tree: t\\nroot:\\n  succeed: x\\n"
    lines = (
        '{"jsonrpc":"2.0","id":1,"method":"initialize","params":{"protocolVersion":"2025-06-18","capabilities":{},'
        '"clientInfo":{"name":"test","version":"1"}}}',
        '{"jsonrpc":"2.0","method":"notifications/initialized"}',
        f'{{"jsonrpc":"2.0","id":2,"method":"tools/call","params":{{"name":"check","arguments":{{"tree":"{tree}"}}}}}}',
    )
    command = [sys.executable, "-m", "mpvi_bt.apps.cli", "mcp"]
    process = subprocess.Popen(
        command, cwd=root, env=_environment(root), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        for line in lines:
            process.stdin.write(line + "\n")
            process.stdin.flush()
        answers = {answer["id"]: answer for answer in map(json.loads, (process.stdout.readline() for _ in range(2)))}
    finally:
        process.stdin.close()
        process.wait(timeout=60)
    assert not answers[2]["result"].get("isError"), answers[2]


def test_a_policy_is_served(root: Path) -> None:
    """`mpvi serve`, with a policy of one's own."""
    with serving(root, r"ws://127\.0\.0\.1:(\d+)", "serve", "mine:Still", "--port", "0") as found:
        assert int(found[1]) > 0


def test_the_house_loads_when_a_task_is_named() -> None:
    """With the wings in place the same door leads to the house."""
    assert task_named("picking_up_trash").house
