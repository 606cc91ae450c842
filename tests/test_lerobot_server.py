"""The client of LeRobot's PolicyServer: what a stand-in gets, what a bad one does to us, and LeRobot's own."""

from __future__ import annotations

import math
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mpvi_bt.executive.remote.dialect_settings import DialectSettings
from mpvi_bt.executive.remote.lerobot_pickles import read_chunk
from mpvi_bt.executive.remote.lerobot_policy import LerobotPolicy
from mpvi_bt.executive.remote.lerobot_server import LerobotServerPolicy
from mpvi_bt.ground.errors import BadMessage, PolicyError, UserError
from mpvi_bt.ground.robot.action_rows import state_of
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.policies import PolicyInputs, make_policy, paced
from mpvi_bt.testing import check_policy
from mpvi_bt.testing.doubles import KinematicRobot
from tests.layouts import ACTION_SIZE, LAYOUT
from tests.lerobot_files import OURS, checkpoint, dataset
from tests.lerobot_servers import HOME, ROWS, LerobotServer, chunk_of, pickled_chunk
from tests.numbered_body import numbered_body
from tests.remote_servers import free_port

ELBOW = LAYOUT.arm["right"].start + 3

pytest.importorskip("grpc", reason="needs the extra lerobot-grpc")
pytest.importorskip("torch", reason="the stand-in answers tensors of torch's, as LeRobot does")


@pytest.fixture
def trained(tmp_path: Path) -> Path:
    """A checkpoint of ours, its dataset beside it."""
    return checkpoint(tmp_path / "act", dataset(tmp_path / "picks"))


def policy_at(server: LerobotServer | str, folder: Path, **changed: Any) -> LerobotServerPolicy:
    address = server if isinstance(server, str) else server.address
    settings = DialectSettings().model_copy(update={"connect_s": 60.0, "answer_s": 60.0, "tries": 1, **changed})
    return LerobotServerPolicy(f"{address}{folder}", settings, robot="r1")


def seen(prompt: str = "pick up the cup") -> dict[str, Any]:
    images = {camera: KinematicRobot().look(camera) for camera in ("head", "right")}
    return {"prompt": prompt, "proprioception": numbered_body("r1"), "images": images}


@contextmanager
def fails(reason: str, *words: str) -> Iterator[None]:
    """The block raises a PolicyError of that reason, on one printable line that has the words and the address."""
    with pytest.raises(PolicyError) as caught:
        yield
    assert caught.value.reason == reason, caught.value
    assert str(caught.value).isprintable()
    for word in ("lerobot:grpc://", *words):
        assert word in str(caught.value)


def test_it_is_a_policy(trained: Path) -> None:
    """The client keeps the contract of policies on one connection; rate and cameras are the checkpoint's."""
    with LerobotServer() as server:
        policy = policy_at(server, trained)
        check_policy(policy)
        assert (policy.connections, policy.rate_hz, policy.cameras) == (1, 10.0, ("head", "right"))
        policy.close()


def test_it_is_spoken_to_as_lerobots_own_client_does(trained: Path) -> None:
    """It is told what to load, then each observation by names, with the prompt as its task; the chunk is read."""
    with LerobotServer() as server:
        policy, given = policy_at(server, trained), seen("open the fridge")
        policy.reset()
        actions = policy.infer(given)
        policy.close()
    assert server.calls == ["Ready", "SendPolicyInstructions", "Ready", "SendObservations", "GetActions"]
    (setup,) = server.setups
    assert (setup["policy_type"], setup["pretrained_name_or_path"]) == ("act", str(trained))
    assert (setup["actions_per_chunk"], setup["device"], setup["rename_map"]) == (ROWS, "cpu", {})
    features = setup["lerobot_features"]
    assert features["observation.images.head"]["shape"] == (48, 64, 3)
    assert features["observation.state"]["names"] == [f"state_{k}" for k in range(ACTION_SIZE)]
    (told,) = server.seen
    assert (told["must_go"], told["timestep"], told["observation"]["task"]) == (True, 1, "open the fridge")
    assert told["observation"]["head"].shape == (48, 64, 3)
    assert server.pieces == [3]
    felt = state_of(given["proprioception"])
    np.testing.assert_allclose(actions, felt[None] + np.arange(ROWS)[:, None], rtol=1e-6)


def test_a_large_observation_goes_in_pieces(tmp_path: Path) -> None:
    """Each says whether it is the first, one between or the last."""
    large = {**OURS, "observation.images.head": {"type": "VISUAL", "shape": [3, 1500, 1000]}}
    folder = checkpoint(tmp_path / "act", dataset(tmp_path / "picks"), input_features=large)
    with LerobotServer() as server:
        policy = policy_at(server, folder)
        policy.infer(seen())
        policy.close()
    assert server.pieces == [1, 2, 3]
    assert server.seen[0]["observation"]["head"].shape == (1500, 1000, 3)


def test_the_folder_may_be_another_one_there(trained: Path) -> None:
    """The settings name a copy of its JSON files here; the server is told its own."""
    (trained / "model.safetensors").unlink()
    with LerobotServer() as server:
        policy = policy_at(server, Path("/far/away/act"), checkpoint=str(trained), device="cuda")
        policy.reset()
        policy.close()
    assert (server.setups[0]["pretrained_name_or_path"], server.setups[0]["device"]) == ("/far/away/act", "cuda")


@pytest.mark.parametrize("fps", [10, 15, 30])
def test_a_motion_takes_its_time_whatever_rate_its_dataset_has(fps: int, tmp_path: Path) -> None:
    """Rows of an elbow that a checkpoint closes by 0.3 rad/s: after two seconds it is 0.6 rad further at any rate."""

    def onward(step: int, seen: dict[str, Any]) -> bytes:
        rows = np.repeat([[seen[f"state_{k}"] for k in range(ACTION_SIZE)]], ROWS, axis=0).astype(np.float32)
        rows[:, ELBOW] += 0.3 * np.arange(1, ROWS + 1) / fps
        return pickled_chunk(step, rows)

    folder = checkpoint(tmp_path / "act", dataset(tmp_path / "picks", fps=fps))
    robot = KinematicRobot()
    began = robot.proprioception().arm["right"][3]
    with LerobotServer(onward) as server:
        policy = paced(policy_at(server, folder), EpisodeConfig("picking_up_trash", policy="lerobot:it"))
        policy.reset()
        steps = 0
        while steps < 2 * CONTROL_HZ:
            images = {camera: robot.look(camera) for camera in policy.cameras}
            given = {"prompt": "fold", "proprioception": robot.proprioception(), "images": images}
            for action in policy.infer(given | {"command": robot.action})[: 2 * CONTROL_HZ - steps]:
                robot.act(action)
                robot.advance(robot.action)
                steps += 1
        policy.close()
    assert robot.proprioception().arm["right"][3] - began == pytest.approx(0.6, abs=1e-4)
    assert len(server.seen) == math.ceil(2 * fps / ROWS)


def other_step(step: int, seen: dict[str, Any]) -> bytes:
    return pickled_chunk(step + 1, chunk_of(seen))


def evil(step: int, seen: dict[str, Any]) -> bytes:
    class Run:
        def __reduce__(self) -> Any:
            return exec, ("import builtins; builtins.broken_into = True",)

    return pickle.dumps([Run()])


def broken(step: int, seen: dict[str, Any]) -> bytes:
    raise ValueError("no such feature")


@pytest.mark.parametrize(
    ("answer", "reason", "said"),
    [
        (lambda step, seen: b"", "server_error", "Error in StreamActions"),
        (lambda step, seen: b"nonsense", "bad_reply", "not a pickle of actions"),
        (lambda step, seen: pickle.dumps([1, 2]), "bad_reply", "not a list of TimedAction"),
        (lambda step, seen: pickle.dumps([]), "bad_reply", "not a list of TimedAction"),
        (lambda step, seen: pickled_chunk(step, chunk_of(seen)[:, :7]), "bad_reply", "of shape (8, 7)"),
        (lambda step, seen: pickled_chunk(step, chunk_of(seen) * np.nan), "bad_reply", "not finite"),
        (lambda step, seen: pickled_chunk(step, chunk_of(seen), "TimedData"), "bad_reply", "which is not loaded"),
        (other_step, "bad_reply", "actions for observation 2, and 1 was sent"),
        (evil, "bad_reply", "builtins.exec"),
        (broken, "server_error", "no such feature"),
    ],
)
def test_an_answer_that_is_none_is_told_of(
    trained: Path, answer: Callable[[int, dict[str, Any]], bytes], reason: str, said: str
) -> None:
    """Whatever it is; nothing that a pickle names is loaded."""
    with LerobotServer(answer) as server, fails(reason, said):
        policy_at(server, trained).infer(seen())
    assert not hasattr(__import__("builtins"), "broken_into")


@pytest.mark.parametrize("dtype", ["f4", "f8", "f2"])
def test_a_chunk_is_read_as_torch_wrote_it(dtype: str) -> None:
    """Rows are views of one tensor, of each kind of numbers; also where it was turned about."""
    rows = np.arange(12, dtype=dtype).reshape(3, 4) / 4
    for given in (rows, np.asfortranarray(rows)):
        step, read = read_chunk(pickled_chunk(7, given))
        assert step == 7
        np.testing.assert_array_equal(read, rows)


def test_a_broken_chunk_is_never_more_than_a_bad_message() -> None:
    """With any byte cut off or changed the reader says so, or reads numbers: it never breaks."""
    whole = pickled_chunk(1, np.ones((2, 3), np.float32))
    random = np.random.default_rng(0)
    for _ in range(400):
        changed = bytearray(whole[: random.integers(1, len(whole) + 1)])
        changed[random.integers(len(changed))] = random.integers(256)
        try:
            _, read = read_chunk(bytes(changed))
        except BadMessage:
            continue
        assert read.shape[-1] <= 6


@pytest.mark.parametrize(
    "bent",
    [
        b"cos\nsystem\n(S'true'\ntR.",
        b"ctorch._utils\n_rebuild_tensor_v2\n}S'x'\nI1\nsb.",  # sets an attribute of a function
        f"c{HOME}\nTimedAction\n}}S'x'\nI1\nsb.".encode(),  # and of a class
        b"\x80\x02j\xff\xff\xff\x7f.",
    ],
    ids=["a command", "a function", "a class", "a large index"],
)
def test_a_pickle_can_do_nothing_here(bent: bytes) -> None:
    """Neither load a name, nor change what stands for one, nor take memory by an index."""
    with pytest.raises(BadMessage):
        read_chunk(bent)


def test_a_server_that_is_not_there_is_told_of(trained: Path) -> None:
    """After the time of the settings."""
    with fails("server_absent", "no server of gRPC"):
        policy_at(f"grpc://127.0.0.1:{free_port()}", trained, connect_s=0.5).reset()


def test_a_server_of_something_else_is_told_of(trained: Path) -> None:
    """One of gRPC that serves no policies."""
    with LerobotServer(service="another.Service") as server, fails("bad_reply", "no PolicyServer of LeRobot's"):
        policy_at(server, trained).reset()


def test_a_server_that_comes_back_is_told_again_what_to_load(trained: Path) -> None:
    """A lost connection is made anew, and the same observation is asked about."""
    first = LerobotServer()
    policy = policy_at(first, trained)
    policy.infer(seen())
    first.stop()
    with LerobotServer(port=first.port) as second:
        assert policy.infer(seen()).shape == (ROWS, ACTION_SIZE)
        assert [setup["policy_type"] for setup in second.setups] == ["act"]
        policy.close()


@pytest.mark.parametrize(
    ("config", "said"),
    [
        ({"n_obs_steps": 2}, "asked for each row, and LeRobot's server answers chunks"),
        ({"input_features": {"observation.base_pose": {"type": "STATE", "shape": [3]}}}, "no 'observation.state'"),
    ],
)
def test_what_that_server_would_not_do_is_refused(trained: Path, config: dict[str, Any], said: str) -> None:
    """Before it is asked: in this process the checkpoint runs."""
    with pytest.raises(UserError, match=said):
        policy_at("grpc://h:1", checkpoint(trained, **config))


@pytest.mark.parametrize(
    ("address", "said"),
    [
        ("grpc://h:1", "write grpc://HOST:PORT/FOLDER"),
        ("grpc://h:1/no/such/folder", "no checkpoint of LeRobot's is there.*`checkpoint`"),
        ("grpc://h:0/x", "no address of a policy server"),
    ],
)
def test_an_address_without_a_checkpoint_is_refused(address: str, said: str) -> None:
    """The server loads what it is told, so somebody has to tell it."""
    with pytest.raises(UserError, match=said):
        make_policy(f"lerobot:{address}", PolicyInputs({}, robot="r1"))


@contextmanager
def policy_server(folder: Path) -> Iterator[str]:
    """LeRobot's PolicyServer, started by its own command; its address."""
    port = free_port()
    command = [sys.executable, "-m", "lerobot.async_inference.policy_server", "--host=127.0.0.1", f"--port={port}"]
    with (folder / "server.log").open("w") as log, subprocess.Popen(command, cwd=folder, stdout=log, stderr=log) as one:
        try:
            yield f"grpc://127.0.0.1:{port}"
        finally:
            one.kill()


@pytest.mark.slow
def test_lerobots_own_server_gives_the_actions_of_this_process(tmp_path: Path) -> None:
    """To 1e-5, for several observations and after a handoff; and a checkpoint that it cannot load is told of."""
    pytest.importorskip("lerobot", reason="needs the extra lerobot, in an environment of its own (docs/lerobot.md)")
    from tests.test_lerobot_policy import small_act

    folder = small_act(tmp_path / "act")
    here = LerobotPolicy(folder, DialectSettings(), "r1")
    with policy_server(tmp_path) as address:
        there = policy_at(address, folder, connect_s=120.0, answer_s=120.0)
        for prompt in ("pick up the cup", "pick up the bowl"):
            there.reset()
            for _ in range(2):
                given = seen(prompt)
                np.testing.assert_allclose(there.infer(given), here.infer(given), atol=1e-5)
        assert there.connections == 1
        there.close()
        with fails("server_error", "the server says"):
            policy_at(address, Path("/no/such/folder"), checkpoint=str(folder), connect_s=120.0).reset()
