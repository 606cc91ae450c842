"""A policy server for tests, and what they send to it."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from websockets.sync.client import ClientConnection, connect

from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.remote.codec import pack, unpack
from mpvi_bt.executive.remote.observation import Vocabulary
from mpvi_bt.executive.remote.policy_server import Make, PolicyServer
from mpvi_bt.executive.remote.server import SocketServer
from mpvi_bt.ground.protocols import Policy
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.testing.doubles import GripPolicy, KinematicRobot
from tests.layouts import CAMERAS

Server = TypeVar("Server", bound=SocketServer)


def grip(vocabulary: Vocabulary | None = None) -> Policy:
    """A policy that needs no picture."""
    return GripPolicy(load_skills())


@contextlib.contextmanager
def serving(make: Make = grip, api_key: str = "", idle_s: float | None = None) -> Iterator[PolicyServer]:
    """A server of policies at a free port of this machine, in a thread of its own."""
    with running(PolicyServer("grip", make, api_key, idle_s=idle_s)) as server:
        yield server


@contextlib.contextmanager
def running(server: Server) -> Iterator[Server]:
    """A server at a free port of this machine, in a thread of its own."""
    started, ended, loop = threading.Event(), asyncio.Event(), asyncio.new_event_loop()

    async def serve() -> None:
        async with server.listening("127.0.0.1", 0):
            started.set()
            await ended.wait()

    thread = threading.Thread(target=loop.run_until_complete, args=(serve(),))
    thread.start()
    assert started.wait(10)
    try:
        yield server
    finally:
        loop.call_soon_threadsafe(ended.set)
        thread.join(10)
        assert not thread.is_alive()
        loop.close()


def client(server: SocketServer, **options: Any) -> ClientConnection:
    """Somebody who knows nothing but the protocol; the metadata are still to be received."""
    options = {"compression": None, "max_size": None, **options}
    return connect(f"ws://127.0.0.1:{server.port}", **options)


def received(connection: ClientConnection) -> Any:
    """The next message, such as the metadata, which come first."""
    frame = connection.recv(timeout=10)
    assert isinstance(frame, bytes)
    return unpack(frame)


def ask(connection: ClientConnection, message: Any) -> Any:
    """One round trip: the answer, or the text of an error frame."""
    connection.send(message if isinstance(message, str | bytes) else pack(message))
    answer = connection.recv(timeout=10)
    return answer if isinstance(answer, str) else unpack(answer)


def observation(prompt: str = "pick up the cup", size: int = 8, seed: int = 0, robot: str = "r1") -> dict[str, Any]:
    """What a policy is shown: a robot at rest, and three pictures of noise."""
    rng = np.random.default_rng(seed)
    images = {
        camera: CameraImage(
            camera,
            rng.integers(0, 256, (size, size, 3), np.uint8),
            rng.random((size, size), np.float32),
            rng.integers(0, 3, (size, size), np.int32),
            {1: "cup.n.01_1", 2: "robot"},
            rng.random((3, 3)),
            rng.random((4, 4)),
        )
        for camera in CAMERAS
    }
    body = KinematicRobot().proprioception()
    return {"prompt": prompt, "proprioception": replace(body, arm_command=body.arm, robot=robot), "images": images}
