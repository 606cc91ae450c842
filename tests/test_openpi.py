"""The client of policy servers over real sockets: what a good server gets, in each dialect."""

from __future__ import annotations

import gc
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mpvi_bt.executive.remote.connection import KEY
from mpvi_bt.executive.remote.dialect_settings import DialectSettings, load_settings
from mpvi_bt.executive.remote.openpi import OpenpiPolicy, url_of
from mpvi_bt.ground.errors import UserError
from mpvi_bt.testing import check_policy
from tests.layouts import ACTION_SIZE, BASE, CAMERAS
from tests.remote_clients import CHUNK, QUICK, fails, observation, policy_at, quick
from tests.remote_servers import HOST, PolicyServer, free_port
from tests.serving import serving


@pytest.fixture(autouse=True)
def _no_key(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(KEY, raising=False)


def test_it_is_a_policy() -> None:
    """The client keeps the contract of policies, on one connection."""
    with PolicyServer() as server:
        policy = policy_at(server)
        check_policy(policy)
        assert server.connections == 1
        assert policy.name == f"openpi:{server.address}"


def test_a_native_server_is_spoken_to_as_openpi_does() -> None:
    """One message an inference with the settings' keys and this call's prompt, and none at a reset; no compression."""
    with PolicyServer(lambda message: {"actions": CHUNK, "server_timing": {"infer_ms": 1.0}}) as server:
        policy = policy_at(server)
        for prompt in ("open the fridge", "close the fridge"):
            policy.reset()
            actions = policy.infer(observation(prompt=prompt))
        layout = load_settings("openpi_comet").observation
        assert layout is not None
        assert [message["prompt"] for message in server.received] == ["open the fridge", "close the fridge"]
        for message in server.received:
            assert set(message) == {"prompt", *layout.images, *layout.state}
        np.testing.assert_allclose(actions[:, 3:], CHUNK[:, 3:])
        np.testing.assert_allclose(actions[:, BASE], CHUNK[:, :3] * [0.75, 0.75, 1.0], rtol=1e-6)
        (headers,) = server.headers
        assert "Sec-WebSocket-Extensions" not in headers
        assert "Authorization" not in headers


@pytest.mark.parametrize("name", ["behavior_2025", "behavior_2026"])
def test_a_behavior_server_is_spoken_to_as_its_evaluator_does(name: str) -> None:
    """A reset is a message without a reply; observations have flattened names; one action is under `action`."""
    server = PolicyServer(lambda message: None if "reset" in message else {"action": CHUNK[:1]})
    with server:
        policy = OpenpiPolicy(server.address, load_settings(name).model_copy(update={**QUICK, "answer_s": 20.0}))
        check_policy(policy)
        policy.reset()
        assert policy.infer(observation()).shape == (1, ACTION_SIZE)
        assert server.received[0] == {"reset": True}
        assert [m == {"reset": True} for m in server.received[-2:]] == [True, False]
        assert "robot_r1::proprio" in server.received[-1]
        assert "prompt" not in server.received[-1]


@pytest.mark.parametrize("able", [True, False])
def test_behaviors_chunks_are_asked_for(able: bool) -> None:
    """With request_chunk the number is sent; a server that cannot answers one action, which is a chunk too."""

    def answer(message: Any) -> Any:
        size = message["__action_chunk_size__"]
        return {"action": CHUNK[0]} | ({"action_chunk": CHUNK[:size]} if able else {})

    settings = load_settings("behavior_2026").model_copy(
        update={**QUICK, "answer_s": 20.0, "request_chunk": 3, "reset_message": False}
    )
    with PolicyServer(answer) as server:
        assert len(OpenpiPolicy(server.address, settings).infer(observation())) == (3 if able else 1)


@pytest.mark.parametrize("chunk", [CHUNK[:2], CHUNK[1:4]], ids=["too short", "begins otherwise"])
def test_behaviors_chunks_are_as_its_evaluator_wants_them(chunk: Any) -> None:
    """As many as were asked for, and the first is the action."""
    settings = load_settings("behavior_2026").model_copy(update={**QUICK, "answer_s": 20.0, "request_chunk": 3})
    answer = {"action": CHUNK[0], "action_chunk": chunk}
    with PolicyServer(lambda message: answer) as server, fails("bad_reply", 15.0, "chunk"):
        OpenpiPolicy(server.address, settings).infer(observation())


def test_our_own_client_and_server_agree() -> None:
    """A policy behind both acts as it does in process, asks for its pictures as it goes, and begins anew at a reset."""

    class Looker:
        name = "looker"
        cameras: tuple[str, ...] = ()

        def __init__(self) -> None:
            self.reset()

        def reset(self) -> None:
            self.calls, self.cameras, self.note, self.gave_up = 0, ("head",), "new", False
            self.progress, self.ended = 0.0, False

        def infer(self, seen: Any) -> Any:
            assert set(self.cameras) <= set(seen["images"])
            self.calls += 1
            self.cameras = ("left", "right") if self.calls % 2 else ()
            self.note, self.gave_up = f"call {self.calls}", self.calls > 2
            self.progress, self.ended = self.calls / 3, self.calls > 1
            images = sum(float(image.rgb.sum() + image.depth.sum()) for image in seen["images"].values())
            return np.full((2, ACTION_SIZE), self.calls + images + float(seen["proprioception"].torso.sum()))

    alone = Looker()
    with serving(lambda _: Looker()) as server:
        remote = OpenpiPolicy(f"{HOST}:{server.port}", DialectSettings().model_copy(update=QUICK))
        for _ in range(2):
            alone.reset()
            remote.reset()
            assert remote.cameras == ("head",)
            for _ in range(3):
                seen = observation(remote.cameras)
                assert np.array_equal(remote.infer(seen), alone.infer(seen))
                assert (remote.cameras, remote.note) == (alone.cameras, alone.note)
                assert (remote.gave_up, remote.ended, remote.progress) == (alone.gave_up, alone.ended, alone.progress)
            assert remote.gave_up
        assert remote.connections == 1


def test_our_own_server_gets_the_whole_observation() -> None:
    """Without a layout everything goes, pictures with depth and labels, and whether to begin anew."""
    with PolicyServer(lambda message: {"actions": CHUNK}) as server:
        policy = OpenpiPolicy(server.address, DialectSettings().model_copy(update=QUICK))
        policy.reset()
        seen = observation()
        policy.infer(seen)
        policy.infer(seen)
        policy.reset()
        assert np.array_equal(policy.infer(seen), CHUNK)
        assert [message["reset"] for message in server.received] == [True, False, True]
        message, image = server.received[0], seen["images"]["head"]
        assert np.array_equal(message["images"]["head"]["depth"], image.depth)
        assert message["images"]["head"]["rgb"].dtype == np.uint8
        assert np.array_equal(message["proprioception"]["arm"]["left"], seen["proprioception"].arm["left"])


def test_a_server_may_name_the_cameras_that_it_wants() -> None:
    """From metadata and answers; only what the settings map is asked for, and what is no list of cameras is ignored."""
    wishes = iter([["left"], [], ["right", "head"], "head", ["top"], {"head": 1}])
    with PolicyServer(lambda message: {"actions": CHUNK, "cameras": next(wishes)}, {"cameras": ["head"]}) as server:
        policy = policy_at(server)
        assert policy.cameras == CAMERAS
        policy.reset()
        assert policy.cameras == ("head",)
        wanted = []
        for _ in range(6):
            policy.infer(observation(policy.cameras))
            wanted.append(policy.cameras)
        assert wanted == [("left",), (), ("head", "right"), ("head", "right"), ("head", "right"), ("head", "right")]
        assert "observation/wrist_image_left" not in server.received[0]
        assert "observation/egocentric_camera" not in server.received[1]


def test_what_a_server_notes_is_one_line() -> None:
    """Its note is shown to people, so it has no line breaks or escapes, and an end."""
    note = "waiting\n\x1b[2J for \u202e the cup " + "x" * 5000
    with PolicyServer(lambda message: {"actions": CHUNK, "note": note}) as server:
        policy = policy_at(server)
        policy.infer(observation())
        assert policy.note.startswith("waiting [2J for the cup xxx")
        assert len(policy.note) <= 300


def test_progress_that_is_none_is_not_taken_from_a_server() -> None:
    """Only a number from 0 to 1 is; a policy that says nothing has none."""
    said: list[dict[str, Any]] = [{"progress": p} for p in (0.5, 1, -0.1, 1.1, float("nan"), True, "half", [0.5], None)]
    answers = iter([*said, {}])
    with PolicyServer(lambda message: {"actions": CHUNK, **next(answers)}) as server:
        policy = policy_at(server)
        heard = []
        for _ in range(10):
            policy.infer(observation())
            heard.append(policy.progress)
    assert heard == [0.5, 1.0, *[None] * 8]


def test_the_key_of_the_environment_is_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    """As openpi's header, and it stands in no name."""
    monkeypatch.setenv(KEY, "sesame")
    with PolicyServer(key="sesame") as server:
        policy = policy_at(server)
        policy.infer(observation())
        assert server.headers[0]["Authorization"] == "Api-Key sesame"
        assert "sesame" not in policy.name


def test_a_policy_that_is_dropped_hangs_up() -> None:
    """A server is not left with the connections of episodes that are over."""
    with PolicyServer() as server:
        policy = policy_at(server)
        policy.reset()
        del policy
        gc.collect()
        waited = time.monotonic() + 2
        while server.open[0].close_code is None and time.monotonic() < waited:
            time.sleep(0.01)
        assert server.open[0].close_code == 1000


def test_the_server_of_the_page_is_one(tmp_path: Path) -> None:
    """What the page tells authors of servers is enough: its server, with its settings, drives a robot."""
    docs = Path(__file__).parent.parent / "docs"
    section = (docs / "serving_policies.md").read_text(encoding="utf-8").partition("## Writing a server")[2]
    (code,) = re.findall(r"^```python\n(.*?)^```$", section, re.MULTILINE | re.DOTALL)
    (settings,) = re.findall(
        r"^```yaml\n(.*?)^```$",
        (docs / "policy_servers.md").read_text(encoding="utf-8"),
        re.MULTILINE | re.DOTALL,
    )
    (tmp_path / "mine.yaml").write_text(settings)
    port = free_port()
    assert "8000" in code
    command = [sys.executable, "-u", "-c", code.replace("8000", str(port))]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            policy = OpenpiPolicy(f"{HOST}:{port}", str(tmp_path / "mine.yaml"))
            policy.reset()
            assert policy.infer(observation(prompt="pick up the cup")).shape == (8, ACTION_SIZE)
            assert process.stdout is not None
            assert process.stdout.readline() == "pick up the cup (18,) (224, 224, 3)\n"
            policy.close()
        finally:
            process.kill()


@pytest.mark.parametrize(
    ("address", "url"),
    [
        ("ws://gpu:9000", "ws://gpu:9000"),
        ("wss://gpu.example", "wss://gpu.example:8000"),
        ("gpu", "ws://gpu:8000"),
        ("127.0.0.1:80", "ws://127.0.0.1:80"),
        ("ws://[::1]:5/deep/path", "ws://[::1]:5/deep/path"),
    ],
)
def test_addresses(address: str, url: str) -> None:
    """A scheme and a port may be left out."""
    assert url_of(address) == url


@pytest.mark.parametrize(
    "address",
    [
        "",
        "ws://",
        "http://gpu:8000",
        "gpu:many",
        "gpu:99999",
        "gpu:0",
        "ws://gpu:00/path",
        "ws://gpu:8000?key=1",
        "a b",
        "ws://[",
        "x\ny",
        "ws:gpu",
        "x" * 70,
    ],
)
def test_what_is_no_address_is_told(address: str) -> None:
    """Before any episode, with the form of one."""
    with pytest.raises(UserError, match=r"ws://HOST:PORT"):
        OpenpiPolicy(address, quick())


def test_a_key_in_an_address_is_not_repeated() -> None:
    """Keys come from the environment; one that was typed into an address is not shown again."""
    with pytest.raises(UserError) as caught:
        OpenpiPolicy("ws://user:secret@gpu:8000", quick())
    assert "secret" not in str(caught.value)
    assert KEY in str(caught.value)
