"""The published `openpi_client` package drives our server: what it gets is what our policies give in process."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.remote.codec import pack, unpack
from mpvi_bt.executive.remote.observation import Vocabulary, write_observation
from mpvi_bt.executive.remote.openpi import OpenpiPolicy
from mpvi_bt.ground.errors import PolicyError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Policy
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, SIDES
from mpvi_bt.runs.choices.policies import PolicyInputs, make_policy
from mpvi_bt.testing import KinematicRobot
from tests.layouts import LAYOUT
from tests.openpi_env import openpi_python
from tests.serving import grip, observation, serving
from tests.small_house import placed, small_world

EPISODE_S = 15.0  # of simulated time

# Runs in an environment of its own. Messages and answers pass through files in openpi's own encoding.
CLIENT = """
import sys
from openpi_client import msgpack_numpy
from openpi_client.websocket_client_policy import WebsocketClientPolicy
port, messages, answers = sys.argv[1:]
policy = WebsocketClientPolicy("127.0.0.1", int(port), api_key="sesame")
answered = [{"metadata": policy.get_server_metadata()}]
for message in msgpack_numpy.unpackb(open(messages, "rb").read()):
    try:
        answered.append(policy.infer(message))
    except RuntimeError as error:
        answered.append(str(error))
open(answers, "wb").write(msgpack_numpy.packb(answered))
"""

# openpi's own server, as its protocol is described: metadata first, then an answer for each observation; an error is a
# text frame, then close code 1011. Messages are packed and unpacked by the published package.
SERVER = """
import asyncio, sys, traceback
import numpy as np
import websockets
from openpi_client import msgpack_numpy
from websockets.asyncio.server import serve

async def talk(connection):
    pack = msgpack_numpy.Packer().pack
    await connection.send(pack({"model": "echo"}))
    try:
        while True:
            seen = msgpack_numpy.unpackb(await connection.recv())
            state, head = seen["observation/state"], seen["observation/egocentric_camera"]
            assert (state.shape, head.shape, head.dtype) == ((256,), (224, 224, 3), np.uint8)
            posture = np.concatenate([[0, 0, 0], state[236:240], state[158:165], [1], state[197:204], [-1]])
            answer = {"actions": np.tile(posture, (32, 1)), "state": state, "policy_timing": {"infer_ms": 1.0}}
            await connection.send(pack({**answer, "prompt": seen["prompt"]}))
    except websockets.ConnectionClosed:
        pass
    except Exception:
        await connection.send(traceback.format_exc())
        await connection.close(1011, "Internal server error. Traceback included in previous frame.")

async def main():
    async with serve(talk, "127.0.0.1", 0, compression=None, max_size=None) as server:
        print(server.sockets[0].getsockname()[1], flush=True)
        await server.serve_forever()

asyncio.run(main())
"""


class Recorder:
    """A policy that keeps what it was shown and what it did.

    Attributes:
        asked: Observation and whether it was the first after a reset.
        acted: Its answers, with the cameras that it wanted next.
    """

    def __init__(self, policy: Policy) -> None:
        self.name = policy.name
        self._policy, self._fresh = policy, True
        self.asked: list[tuple[Mapping[str, Any], bool]] = []
        self.acted: list[tuple[Array, list[str]]] = []

    @property
    def cameras(self) -> tuple[str, ...]:
        return self._policy.cameras

    @property
    def note(self) -> str:
        return str(getattr(self._policy, "note", ""))

    def reset(self) -> None:
        self._policy.reset()
        self._fresh = True

    def infer(self, observation: Mapping[str, Any]) -> Array:
        self.asked.append((observation, self._fresh))
        chunk = self._policy.infer(observation)
        self.acted.append((chunk.copy(), list(self.cameras)))
        self._fresh = False
        return chunk


@contextlib.contextmanager
def mpvi_serve(policy: str) -> Iterator[int]:
    """`mpvi serve` of a policy in a process of its own; its port."""
    command = [
        sys.executable,
        "-c",
        "from mpvi_bt.apps.cli import main; main()",
        "serve",
        policy,
        "--port",
        "0",
        "--json",
    ]
    environment = {**os.environ, "OPENPI_API_KEY": "sesame"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout is not None
        try:
            yield int(json.loads(process.stdout.readline())["port"])
            process.send_signal(signal.SIGINT)
            assert process.wait(30) == 0
            assert json.loads(process.stdout.readline())["errors"] == {}
        finally:
            process.kill()


def replayed(port: int, messages: Sequence[dict[str, Any]], folder: Path) -> list[Any]:
    """The metadata, then the answers that openpi_client gets to the messages."""
    sent, got = folder / "messages", folder / "answers"
    sent.write_bytes(pack(list(messages)))
    command = [openpi_python(), "-c", CLIENT, str(port), str(sent), str(got)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    answers: list[Any] = unpack(got.read_bytes())
    return answers


def messages_of(recorder: Recorder, vocabulary: Vocabulary | None = None) -> list[dict[str, Any]]:
    """What was shown to a policy, as a client sends it."""
    return [write_observation(seen, fresh, vocabulary) for seen, fresh in recorder.asked]


def require_the_same(recorder: Recorder, answers: Sequence[Any]) -> None:
    """Every action equal bit by bit, and the cameras too."""
    assert len(answers) == len(recorder.acted)
    for answer, (actions, cameras) in zip(answers, recorder.acted, strict=True):
        assert answer["actions"].dtype == actions.dtype
        assert np.array_equal(answer["actions"], actions)
        assert answer["cameras"] == cameras


def moving(recorder: Recorder) -> None:
    """A robot that does what the policy says, with pictures of noise, two prompts and a handoff."""
    robot = KinematicRobot()
    for turn, prompt in enumerate(["pick up the cup, then put it on the table"] * 2 + ["put the cup on the table"]):
        recorder.reset()
        for step in range(6):
            seen = observation(prompt, seed=10 * turn + step)
            for action in recorder.infer({**seen, "proprioception": robot.proprioception()}):
                robot.advance(action)


@pytest.mark.rare
@pytest.mark.slow  # makes an environment where there is none
def test_the_published_client_gets_what_a_policy_does_in_process(tmp_path: Path) -> None:
    """Metadata, actions and cameras, for a policy that counts its calls."""
    moving(recorder := Recorder(grip()))
    with serving(api_key="sesame") as server:
        first, *answers = replayed(server.port, messages_of(recorder), tmp_path)
        assert server.metrics.errors == {}
    assert first["metadata"]["policy"] == "grip"
    require_the_same(recorder, answers)


@pytest.mark.rare
@pytest.mark.slow
def test_the_published_client_is_told_what_was_wrong(tmp_path: Path) -> None:
    """It takes our text frame for what it is, an error of the server's."""
    bad = write_observation(observation())
    del bad["proprioception"]["torso"]
    with serving(api_key="sesame") as server:
        _, told = replayed(server.port, [bad], tmp_path)
    assert told == "Error in inference server:\nbad_message: proprioception: torso is missing"


@pytest.mark.rare
@pytest.mark.slow
def test_our_client_drives_a_server_of_the_published_package() -> None:
    """It is understood by openpi's own packing, gets an r1pro's posture back, and is told of a dialect that is not."""
    seen = observation("pick up the cup", robot="r1pro")
    with subprocess.Popen([openpi_python(), "-c", SERVER], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            address = f"127.0.0.1:{int(process.stdout.readline())}"
            policy = OpenpiPolicy(address, "openpi_comet")
            policy.reset()
            chunk = policy.infer(seen)
            policy.close()
            felt = seen["proprioception"]
            assert chunk.shape == (32, 23)
            np.testing.assert_allclose(chunk[0, LAYOUT.torso], felt.torso, atol=1e-6)
            np.testing.assert_allclose(chunk[0, LAYOUT.arm["right"]], felt.arm["right"], atol=1e-6)
            assert list(chunk[0, [14, 22]]) == [1.0, -1.0]
            behaviors = OpenpiPolicy(address, "openpi_comet_b1k")
            with pytest.raises(PolicyError, match="KeyError: 'observation/state'") as told:
                behaviors.infer(seen)
            assert told.value.reason == "server_error"
        finally:
            process.kill()


def test_our_client_gets_the_same_from_our_server() -> None:
    """With the settings `mpvi`, which send everything: actions, cameras, note."""
    moving(recorder := Recorder(grip()))
    with serving() as server:
        policy = OpenpiPolicy(f"127.0.0.1:{server.port}")
        for (seen, fresh), (actions, cameras) in zip(recorder.asked, recorder.acted, strict=True):
            if fresh:
                policy.reset()
            assert np.array_equal(policy.infer(seen), actions)
            assert list(policy.cameras) == cameras
        policy.close()


@pytest.fixture(scope="module")
def picked() -> tuple[Recorder, Vocabulary]:
    """An episode of `reactive` in process: it picks up a can; and what its labels are called."""
    things = {"can": placed("can_of_soda", 0.85, -0.1, 0.8)}
    world = small_world(things, base=(-0.1, 0.0, 0.0), render=True, table_1="{entry: table, at: [1.0, 0.0]}")
    world.settle()
    vocabulary = {e.name: e.phrases for e in world.knowledge() if e.kind != "room"}
    recorder = Recorder(reactive(vocabulary))
    recorder.reset()
    for _ in range(round(EPISODE_S * CONTROL_HZ)):
        images = {camera: world.robot.look(camera) for camera in recorder.cameras}
        seen = {"prompt": "pick up the can of soda", "proprioception": world.robot.proprioception(), "images": images}
        world.robot.act(recorder.infer(seen)[0])
        world.step()
    assert sum(len(seen["images"]) for seen, _ in recorder.asked) > 3, "it has looked"
    assert any(world.robot.proprioception().holds(side) for side in SIDES), "it has acted"
    return recorder, vocabulary


def reactive(vocabulary: Vocabulary) -> Policy:
    """As `mpvi serve reactive` makes it."""
    return make_policy("reactive", PolicyInputs(load_skills(), vocabulary))


@pytest.mark.rare
@pytest.mark.slow
@pytest.mark.render
def test_the_published_client_gets_what_reactive_does_in_process(
    picked: tuple[Recorder, Vocabulary], tmp_path: Path
) -> None:
    """`mpvi serve reactive` driven by openpi_client: an episode's observations give its actions, bit by bit."""
    recorder, vocabulary = picked
    with mpvi_serve("reactive") as port:
        _, *answers = replayed(port, messages_of(recorder, vocabulary), tmp_path)
    require_the_same(recorder, answers)


@pytest.mark.rare
@pytest.mark.slow
@pytest.mark.render
def test_our_client_gets_what_reactive_does_in_process(picked: tuple[Recorder, Vocabulary]) -> None:
    """The same with our own client, which asks for the same pictures on the way."""
    recorder, vocabulary = picked
    with serving(reactive) as server:
        policy = OpenpiPolicy(f"127.0.0.1:{server.port}", vocabulary=vocabulary)
        policy.reset()
        for (seen, _), (actions, cameras) in zip(recorder.asked, recorder.acted, strict=True):
            assert np.array_equal(policy.infer(seen), actions)
            assert list(policy.cameras) == cameras
        policy.close()
