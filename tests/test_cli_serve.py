"""`mpvi serve` as people and programs run it."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from mpvi_bt.apps.cli.serve import serve
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.remote.codec import unpack
from mpvi_bt.executive.remote.openpi import OpenpiPolicy
from mpvi_bt.ground.errors import UnknownName, UserError
from mpvi_bt.runs.choices.policies import PolicyInputs, demonstrations, make_policy
from tests.conftest import Shell
from tests.serving import observation


def _invoke(*args: str) -> Any:
    return CliRunner().invoke(serve, args, standalone_mode=False)


def test_what_needs_the_simulator_is_not_served() -> None:
    """The expert reads simulator truth, which no client can send; those that can be served are named."""
    error = _invoke("expert").exception
    assert isinstance(error, UserError)
    assert "cannot be served" in str(error)
    assert "reactive" in str(error)


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (["openpi"], "say where"),
        (["openpi:ftp://x"], "no address of a policy server"),
        (["openpi:localhost", "--policy-settings", "comet"], "openpi_comet"),
        (["reactive", "--policy-settings", "mpvi"], "has no settings"),
    ],
)
def test_bad_choices_are_told_before_anybody_connects(args: list[str], said: str) -> None:
    """With what would be right."""
    error = _invoke(*args).exception
    assert isinstance(error, UserError)
    assert said in str(error)


def test_a_name_that_is_nearly_right_is_told() -> None:
    """As everywhere."""
    error = _invoke("reactiv").exception
    assert isinstance(error, UnknownName)
    assert error.nearest == "reactive"


def test_a_port_that_is_taken_is_bad_usage() -> None:
    """In one line, with the address."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        error = _invoke("openpi:localhost:1", "--port", str(port)).exception
    assert isinstance(error, UserError)
    assert str(error) == f"cannot listen at 127.0.0.1:{port}: address already in use"


def test_no_host_is_bad_usage() -> None:
    """An empty one, from a variable that is not set perhaps, would let everybody in."""
    error = _invoke("reactive", "--host", "").exception
    assert isinstance(error, UserError)
    assert "--host is empty" in str(error)


@pytest.mark.parametrize("key", ["a\r\nX: 1", "caf\u00e9", " a", "a\n"])
def test_a_key_that_no_client_can_send_is_told(key: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before anybody is turned away for it, and without the key."""
    monkeypatch.setenv("OPENPI_API_KEY", key)
    error = _invoke("openpi:localhost:1", "--port", "0").exception
    assert isinstance(error, UserError)
    assert "OPENPI_API_KEY" in str(error)
    assert key not in str(error)


@contextlib.contextmanager
def _served(*args: str) -> Iterator[str]:
    """The address of `mpvi serve` in a process of its own."""
    command = [sys.executable, "-m", "mpvi_bt.apps.cli", "serve", *args, "--port", "0", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        try:
            assert process.stdout is not None
            yield json.loads(process.stdout.readline())["address"]
        finally:
            process.kill()


def test_a_client_gets_what_the_methods_get_in_process() -> None:
    """The method e2e, which tells the whole instruction, and one with a tree, which tells prompts: nobody says."""
    skills, vocabulary, known = load_skills(), {"cup.n.01_1": ["cup"]}, demonstrations()
    instruction = next(iter(known))
    with _served("reactive", "--seed", "3") as address:
        for told, whole in ((instruction, known), (known[instruction][0], None), ("sing a song", known)):
            here = make_policy("reactive", PolicyInputs(skills, vocabulary, seed=3, demonstrations=whole))
            there = OpenpiPolicy(address, "mpvi", vocabulary)
            here.reset()
            there.reset()
            for seed in range(4):
                seen = observation(told, seed=seed)
                chunk = here.infer(seen)
                np.testing.assert_array_equal(there.infer(seen), chunk)
                assert there.note == getattr(here, "note", "")
                assert there.cameras == here.cameras
            assert there.note.startswith("no skill") == (told == "sing a song")
            there.close()


def test_tab_offers_what_can_be_served(mpvi: Shell) -> None:
    """The executive, and policies that need no simulator, with the colon where an address follows."""
    done = mpvi(_MPVI_COMPLETE="bash_complete", COMP_WORDS="mpvi serve ", COMP_CWORD="2")
    offered = ("mpvi", "reactive", "learned:", "openpi:", "vla_eval:", "groot:", "lerobot:")
    assert done.stdout.split() == [f"plain,{name}" for name in offered]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_serves_until_it_is_told_to_end(number: int) -> None:
    """It says where it listens, answers, tells clients when it is stopped; told again and again, it ends with 0."""
    command = [sys.executable, "-m", "mpvi_bt.apps.cli", "serve", "reactive", "--port", "0", "--json"]
    environment = {**os.environ, "OPENPI_API_KEY": "sesame"}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as process:
        try:
            assert process.stdout is not None
            told = json.loads(process.stdout.readline())
            with urllib.request.urlopen(f"http://127.0.0.1:{told['port']}/healthz", timeout=30) as response:
                assert response.read() == b"OK\n"
            with connect(told["address"], additional_headers={"Authorization": "Api-Key sesame"}) as connection:
                first = connection.recv(timeout=30)
                assert isinstance(first, bytes)
                assert unpack(first)["policy"] == told["policy"] == "reactive"
                process.send_signal(number)
                with pytest.raises(ConnectionClosed) as closed:
                    connection.recv(timeout=30)
            while process.poll() is None:  # who is impatient asks again
                process.send_signal(number)
                time.sleep(0.01)
            out, error = process.communicate(timeout=30)
        finally:
            process.kill()
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1001
    assert process.returncode == 0
    assert json.loads(out) == {"clients": 1, "answers": 0, "errors": {}}
    begun, ended = error.splitlines()
    assert begun == f"mpvi: serving reactive at {told['address']}; Ctrl-C ends it"
    assert ended.startswith("mpvi: ended: ")
    assert "Traceback" not in error
