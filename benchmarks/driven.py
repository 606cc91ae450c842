"""What a tick of the executive costs behind the socket, over an echo, measured with the published `openpi-client`.

    python -m benchmarks.driven [--python PYTHON]

An observation of BEHAVIOR's evaluator of 2026, with three pictures of 224 x 224 pixels, color and depth, goes over
loopback to a server in a process of its own: to one that unpacks it and answers an action, and to `mpvi serve mpvi`,
which ticks the tree of a task with a policy that answers at once. Both take turns of 20 round trips in the same run, so
that noise meets both. The first 20 ticks of the tree are those of its set-up, and are left out. PYTHON: see
`benchmarks/serving.py`.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import multiprocessing
import statistics
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed

from benchmarks.serving import THEIRS
from mpvi_bt.executive.remote.codec import pack, unpack
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.serving.served import ServedWork, executive_server
from tests.driven import GRIP, observation_2026
from tests.openpi_env import openpi_python

ROUNDS, TRIPS, WARM = 40, 20, 20
TREE = "tree: hand\nroot:\n  timeout: 3600\n  child: {manipulate: pick up a can of soda with the right hand}\n"


async def echo(port: Callable[[int], None], tree: str) -> None:
    """A server that does nothing but unpack, answer and pack."""

    async def client(connection: ServerConnection) -> None:
        await connection.send(pack({}))
        with contextlib.suppress(ConnectionClosed):
            async for frame in connection:
                assert isinstance(frame, bytes)
                unpack(frame)
                await connection.send(pack({"action": np.zeros(23, np.float32)}))

    async with serve(client, "127.0.0.1", 0, compression=None, max_size=None) as server:
        port(next(iter(server.sockets)).getsockname()[1])
        await asyncio.Future()


async def executive(port: Callable[[int], None], tree: str) -> None:
    """`mpvi serve mpvi`, with a tree, or with the plan of the task that observations name."""
    config = EpisodeConfig("", policy=GRIP, map="online", robot="r1pro", tree=tree or None)
    async with executive_server("behavior-2026", ServedWork(config)).listening("127.0.0.1", 0) as server:
        port(server.port)
        await asyncio.Future()


def in_process(kind: Callable[[Callable[[int], None], str], Any], tree: str, pipe: Connection) -> None:
    """Run a server; its port goes into the pipe."""
    asyncio.run(kind(pipe.send, tree))


@contextlib.contextmanager
def driven(
    kind: Callable[[Callable[[int], None], str], Any], tree: str, message: Path, python: Path
) -> Iterator[Callable[[int], list[float]]]:
    """Times [ms] of so many round trips, again and again."""
    near, far = multiprocessing.Pipe()
    server = multiprocessing.get_context("spawn").Process(target=in_process, args=(kind, tree, far), daemon=True)
    server.start()
    command = [str(python), "-c", THEIRS, str(message), str(near.recv())]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as peer:

        def trips(count: int) -> list[float]:
            assert peer.stdin is not None
            assert peer.stdout is not None
            print(count, file=peer.stdin, flush=True)
            return [float(word) for word in peer.stdout.readline().split()]

        trips(WARM)
        yield trips
        assert peer.stdin is not None
        peer.stdin.close()
    server.terminate()


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--python", type=Path, help="of an environment with openpi-client")
    python = parser.parse_args().python or Path(openpi_python())
    print(f"round trips of openpi-client, {ROUNDS * TRIPS} each [ms]\n")
    print(f"{'':40} {'median   p95':>14}   over the echo")
    with tempfile.TemporaryDirectory() as folder:
        message, hand = Path(folder, "message"), Path(folder, "hand.yaml")
        message.write_bytes(pack(observation_2026(224)))
        hand.write_text(TREE)
        with (
            driven(echo, "", message, python) as echoed,
            driven(executive, str(hand), message, python) as manipulating,
            driven(executive, "", message, python) as navigating,
        ):
            kinds = {"echo": echoed, "mpvi, manipulating": manipulating, "mpvi, navigating": navigating}
            times: dict[str, list[float]] = {what: [] for what in kinds}
            for _ in range(ROUNDS):
                for what, trips in kinds.items():
                    times[what] += trips(TRIPS)
    base = statistics.median(times["echo"])
    for what, taken in times.items():
        median = statistics.median(taken)
        print(f"{what:40} {median:6.2f} {np.percentile(taken, 95):6.2f}   {median - base:13.2f}")


if __name__ == "__main__":
    main()
