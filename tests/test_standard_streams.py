"""Standard output is for results: what a user's part, C code or a child process prints goes to standard error."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests import warm

NOISE = '''
import ctypes, os, subprocess, sys
from py_trees.common import Status
from mpvi_bt.executive.behaviors.node import Leaf

def shout():
    """By Python, by the descriptor, by C, by a child process."""
    print("NOISE")
    print("NOISE", file=sys.__stdout__, flush=True)
    os.write(1, b"NOISE\\n")
    c = ctypes.CDLL(None)
    c.printf(b"NOISE\\n")
    c.fflush(None)
    subprocess.run(["echo", "NOISE"])

shout()

class Shout(Leaf):
    def update(self):
        shout()
        return Status.SUCCESS
'''
TREE = "tree: shouting\nnodes: noisy.py\nroot:\n  shout: x\n"
ALWAYS = 5  # lines that `shout` prints


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """With a tree whose nodes print whenever they are imported or ticked."""
    (tmp_path / "noisy.py").write_text(NOISE)
    (tmp_path / "shouting.yaml").write_text(TREE)
    return tmp_path


def mpvi(words: str, folder: Path, redirected: str = "") -> subprocess.CompletedProcess[str]:
    """The command, in a shell where there are redirections; its code is that of `mpvi`."""
    if not redirected:
        return warm.python("-m", "mpvi_bt.apps.cli", *words.split(), cwd=folder, stdin=TREE)
    line = f"{sys.executable} -m mpvi_bt.apps.cli {words} {redirected}; exit ${{PIPESTATUS[0]}}"
    return subprocess.run(
        ["bash", "-c", line], cwd=folder, input=TREE, capture_output=True, text=True, check=False, timeout=100
    )


@pytest.mark.parametrize(
    "words",
    [
        "check --json shouting.yaml",
        "run --dry --tree shouting.yaml --json",
        "schema --nodes noisy.py",
        "fmt -",
        "convert shouting.yaml",
        "render shouting.yaml",
    ],
)
def test_what_parts_print_is_no_result(folder: Path, words: str) -> None:
    """Nothing of it is on standard output, and all of it on standard error."""
    done = mpvi(words, folder)
    assert done.returncode == 0, done.stderr
    assert "NOISE" not in done.stdout
    assert done.stderr.count("NOISE") in (ALWAYS, 2 * ALWAYS)
    if "json" in words or words.startswith("schema"):
        assert isinstance(json.loads(done.stdout), dict)
    else:
        assert "shout" in done.stdout.lower() or "--> x" in done.stdout


def test_help_is_a_result() -> None:
    """Of every command."""
    done = mpvi("run --help", Path.cwd())
    assert done.stdout.startswith("Usage: mpvi run")
    assert done.stderr == ""


def test_mcp_keeps_its_protocol_to_itself(folder: Path) -> None:
    """A tree of MPVI_PATH that is noisy is previewed; each line on standard output is a message of the protocol."""
    pytest.importorskip("mcp")
    (folder / "trees").mkdir()
    for name in ("noisy.py", "shouting.yaml"):
        (folder / name).rename(folder / "trees" / name)
    hello = {"protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": {"name": "t", "version": "0"}}
    call = {"name": "preview", "arguments": {"tree": "shouting"}}
    asked = (
        {"jsonrpc": "2.0", "id": 1, "method": "initialize", "params": hello},
        {"jsonrpc": "2.0", "method": "notifications/initialized"},
        {"jsonrpc": "2.0", "id": 2, "method": "tools/call", "params": call},
    )
    with subprocess.Popen(
        [sys.executable, "-m", "mpvi_bt.apps.cli", "mcp"],
        cwd=folder,
        env={**os.environ, "MPVI_PATH": str(folder)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdin
        assert process.stdout
        answers = []
        for message in asked:
            process.stdin.write(json.dumps(message) + "\n")
            process.stdin.flush()
            if "id" in message:
                answers.append(json.loads(process.stdout.readline()))
        _, told = process.communicate()
    assert "--> x" in json.dumps(answers[1])
    assert told.count("NOISE") == ALWAYS


@pytest.mark.parametrize("redirected", [">&-", "2>&-", "<&- >&- 2>&-", "| head -1", "2>&1 | head -1", "2>/dev/full"])
@pytest.mark.parametrize("words", ["run --dry --tree hello", "--help"])
def test_a_stream_that_is_closed_ends_nothing(tmp_path: Path, words: str, redirected: str) -> None:
    """There is no traceback, and the run is kept whole: its trace ends as it does otherwise."""
    done = mpvi(words, tmp_path, redirected)
    assert done.returncode in (0, 141), done.stderr
    assert "Traceback" not in done.stdout + done.stderr
    if words.startswith("run"):
        (trace,) = (tmp_path / "runs").glob("*.jsonl")
        assert '"end"' in trace.read_text().splitlines()[-1]


@pytest.mark.parametrize("words", ["run --dry --tree hello", "--help"])
def test_a_result_that_cannot_be_printed_is_a_fault_of_the_machine(tmp_path: Path, words: str) -> None:
    """Told in one line."""
    done = mpvi(words, tmp_path, ">/dev/full")
    assert done.returncode == 3
    assert len(done.stderr.splitlines()) == 1
    assert "space" in done.stderr
