"""Every command of the README works, as it stands there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from mpvi_bt.executive.drawing.text import ascii_tree
from mpvi_bt.executive.tree.yaml_io import load_tree
from mpvi_bt.ground.paths import find

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```sh\n(.*?)^```$", README, flags=re.MULTILINE | re.DOTALL)
MAKE = [line.split()[1] for block in BLOCKS for line in block.splitlines() if line.startswith("make ")]

SUITE_OF_ONE = "about: One episode, so that the README's suite is short.\ntasks: [picking_up_trash]\ninstances: [0]\n"


def _parameter(block: str) -> object:
    """One block as a test case; those that run episodes take minutes and draw pictures."""
    runs = re.search(r"mpvi (suite )?run", block)
    marks = [pytest.mark.rare, pytest.mark.slow, pytest.mark.render] if runs else []
    return pytest.param(block, id=block.splitlines()[0], marks=marks)


@pytest.mark.parametrize("block", [_parameter(b) for b in BLOCKS if "make " not in b])
def test_commands_work(block: str, tmp_path: Path) -> None:
    """Each block of commands succeeds, line after line, in a folder that looks like a clone."""
    for entry in ("trees", "skills", "tasks", "examples"):
        (tmp_path / entry).symlink_to(ROOT / entry)
    own = tmp_path / "own" / "tasks" / "suites"
    own.mkdir(parents=True)
    (own / "trash10.yaml").write_text(SUITE_OF_ONE)
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "MPVI_PATH": str(tmp_path / "own")}
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", block],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{done.stdout[-3000:]}\n{done.stderr[-3000:]}"


@pytest.mark.parametrize("target", MAKE)
def test_make_targets_are_there(target: str) -> None:
    """Each make target of the README is one of the Makefile's (they set up machines, so they are not run here)."""
    subprocess.run(["make", "--dry-run", target], cwd=ROOT, check=True, capture_output=True)


def test_the_two_commands_are_the_first() -> None:
    """A newcomer meets `make demo`, then `make test`, before anything else."""
    assert MAKE == ["demo", "test"]
    assert [b.split()[0] for b in BLOCKS[:2]] == ["make", "make"]


def test_continuous_integration_runs_the_test_command() -> None:
    """`.ci/run` calls what the README says runs every test."""
    assert "exec make test-all" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")


@pytest.mark.parametrize("link", sorted(set(re.findall(r"\]\((?!https?:)([^)#]+)\)", README))))
def test_links_lead_somewhere(link: str) -> None:
    """Each link of the README to a file of ours finds it."""
    assert (ROOT / link).exists()


def test_the_tree_at_the_top_is_one_that_runs() -> None:
    """It fits 80 columns, and each of its nodes is one of the shipped tree's, as the live view draws them."""
    drawn = re.search(r"^```\n(\{-\} .*?)^```$", README, flags=re.MULTILINE | re.DOTALL)
    assert drawn
    lines = [line for line in drawn[1].splitlines() if not line.startswith(("[*]", "running: "))]
    assert max(map(len, lines)) <= 80
    known = ascii_tree(load_tree(find("trees", "picking_up_trash")), width=200).splitlines()
    for line in lines:
        label = re.split(r"\.\.\.| \[[-*ox!]\]", line)[0]
        assert any(node.startswith(label) for node in known), line
