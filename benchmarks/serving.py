"""What a round trip costs beyond inference, with our client and with the published `openpi-client`, side by side.

    python benchmarks/serving.py [--python PYTHON]

Three pictures of 224 x 224 pixels go over loopback to a server in a process of its own: once as openpi's policies take
them (rgb, a state, a prompt) to a server that is written as plainly as openpi's, and once with depth, labels and camera
poses to `mpvi serve`. Most of the time it is sent no pictures, as `reactive` asks for none: that is the last line. The
policy answers at once, so that what is measured is the way there and back: packing, two sockets, checking, unpacking.
Clients take turns of 20 round trips in the same run, so that noise meets both.

`openpi-client` needs numpy < 2 and lives in an environment of its own; PYTHON is its interpreter. By default it is the
one that the tests make (tests/openpi_env.py).
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import multiprocessing
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed

from mpvi_bt.executive.remote.codec import pack, unpack
from mpvi_bt.executive.remote.dialect_settings import load_settings
from mpvi_bt.executive.remote.observation import Vocabulary, write_observation
from mpvi_bt.executive.remote.openpi import OpenpiPolicy
from mpvi_bt.executive.remote.policy_server import PolicyServer
from mpvi_bt.executive.remote.wire_mapping import message_of
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Policy
from tests.openpi_env import openpi_python
from tests.serving import observation

ROUNDS, TRIPS, WARM = 40, 20, 40
HORIZON = 32  # of openpi-comet
THEIRS = """
import sys, time
from openpi_client import msgpack_numpy
from openpi_client.websocket_client_policy import WebsocketClientPolicy
message = msgpack_numpy.unpackb(open(sys.argv[1], "rb").read())
policy = WebsocketClientPolicy("127.0.0.1", int(sys.argv[2]))
for line in sys.stdin:
    times = []
    for _ in range(int(line)):
        began = time.perf_counter()
        policy.infer(message)
        times.append(1000 * (time.perf_counter() - began))
    print(*times, flush=True)
"""


class AtOnce:
    """A policy that answers at once."""

    name = "at_once"
    cameras: tuple[str, ...] = ()
    note = ""

    def reset(self) -> None:
        """Nothing to forget."""

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """(32, 23) zeros."""
        return np.zeros((HORIZON, 23))


async def plain(port: Callable[[int], None]) -> None:
    """A server as plain as openpi's: it unpacks, infers and packs where it reads, and checks nothing."""

    async def client(connection: ServerConnection) -> None:
        await connection.send(pack({}))
        with contextlib.suppress(ConnectionClosed):  # clients come and go
            async for frame in connection:
                assert isinstance(frame, bytes)
                unpack(frame)
                await connection.send(pack({"actions": np.zeros((HORIZON, 23)), "server_timing": {"infer_ms": 0.0}}))

    async with serve(client, "127.0.0.1", 0, compression=None, max_size=None) as server:
        port(next(iter(server.sockets)).getsockname()[1])
        await asyncio.Future()


async def ours(port: Callable[[int], None]) -> None:
    """`mpvi serve`."""

    def make(vocabulary: Vocabulary) -> Policy:
        return AtOnce()

    async with PolicyServer("at_once", make).listening("127.0.0.1", 0) as server:
        port(server.port)
        await asyncio.Future()


def in_process(kind: Callable[[Callable[[int], None]], Any], pipe: Connection) -> None:
    """Run a server; its port goes into the pipe."""
    asyncio.run(kind(pipe.send))


def measured(
    kind: Callable[[Callable[[int], None]], Any], settings: str, seen: Mapping[str, Any], python: Path
) -> tuple[list[float], ...]:
    """Times of round trips [ms] with our client and with openpi-client, in turns, to a server of that kind."""
    near, far = multiprocessing.Pipe()
    server = multiprocessing.get_context("spawn").Process(target=in_process, args=(kind, far), daemon=True)
    server.start()
    port = near.recv()
    layout = load_settings(settings).observation
    policy = OpenpiPolicy(f"127.0.0.1:{port}", settings)
    policy.reset()
    with tempfile.NamedTemporaryFile() as file:
        file.write(pack(write_observation(seen) if layout is None else message_of(seen, layout)))
        file.flush()
        command = [str(python), "-c", THEIRS, file.name, str(port)]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as peer:
            assert peer.stdin is not None
            assert peer.stdout is not None

            def theirs(trips: int) -> list[float]:
                print(trips, file=peer.stdin, flush=True)
                return [float(word) for word in peer.stdout.readline().split()]  # type: ignore[union-attr]

            def our(trips: int) -> list[float]:
                times = []
                for _ in range(trips):
                    began = time.perf_counter()
                    policy.infer(seen)
                    times.append(1000 * (time.perf_counter() - began))
                return times

            our(WARM), theirs(WARM)
            pairs = [(our(TRIPS), theirs(TRIPS)) for _ in range(ROUNDS)]
            peer.stdin.close()
    policy.close()
    server.terminate()
    return [time for pair in pairs for time in pair[0]], [time for pair in pairs for time in pair[1]]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--python", type=Path, help="of an environment with openpi-client")
    python = parser.parse_args().python or Path(openpi_python())
    print(f"round trips with a policy that answers at once, {ROUNDS * TRIPS} each [ms]\n")
    print(f"{'message and server':40} {'ours':>14} {'openpi-client':>14}   ours / theirs")
    print(f"{'':40} {'median   p95':>14} {'median   p95':>14}")
    pictures = observation(size=224)
    for what, kind, settings, seen in (
        ("3 x rgb, plain server", plain, "openpi_comet", pictures),
        ("3 x rgb, depth, labels, mpvi serve", ours, "mpvi", pictures),
        ("no pictures, mpvi serve", ours, "mpvi", {**pictures, "images": {}}),
    ):
        both = measured(kind, settings, seen, python)
        (our, _), (their, _) = rows = [(statistics.median(t), np.percentile(t, 95)) for t in both]
        cells = [f"{median:6.2f} {p95:6.2f}" for median, p95 in rows]
        print(f"{what:40} {cells[0]:>14} {cells[1]:>14}   {our / their:10.2f}")


if __name__ == "__main__":
    main()
