"""`mpvi serve`: a policy behind openpi's websocket protocol, until Ctrl-C."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import shutil
import signal
import sys
from typing import TYPE_CHECKING

import click
from click.shell_completion import CompletionItem

from mpvi_bt.cli.given import Choice, File
from mpvi_bt.drawing.cells import one_line
from mpvi_bt.drawing.terminal import draw
from mpvi_bt.errors import PolicyError, UserError
from mpvi_bt.suite.backends import BACKENDS, choose

if TYPE_CHECKING:
    from mpvi_bt.remote.server import PolicyServer

EVERY_S = 1.0  # the status line is drawn anew
_ENDS = (signal.SIGINT, signal.SIGTERM)


def _complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """The policies that can be served."""
    return [CompletionItem(name) for name in _servable() if name.startswith(incomplete)]


def _servable() -> list[str]:
    return [f"{n}:" if b.address else n for n, b in BACKENDS["policy"].items() if not b.privileged]


@click.command()
@click.argument("policy", type=Choice("policy"), shell_complete=_complete)
@click.option(
    "--policy-settings",
    "settings",
    type=File("policies"),
    metavar="NAME",
    help="How a policy that is somewhere else is spoken to, by name or file.",
)
@click.option(
    "--host", default="127.0.0.1", show_default=True, metavar="ADDRESS", help="0.0.0.0 lets other machines in."
)
@click.option("--port", type=click.IntRange(0, 65535), default=8000, show_default=True, help="0: any that is free.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of everything random.")
@click.option(
    "--idle",
    "idle_s",
    type=click.FloatRange(min=1),
    default=300.0,  # Our choice: longer than a robot drives, or a language model thinks, between two prompts
    show_default=True,
    metavar="SECONDS",
    help="Who asks nothing for so long is let go.",
)
@click.option("--json", "as_json", is_flag=True, help="For programs: where it listens, at the end what it did.")
def serve(policy: str, settings: str | None, host: str, port: int, seed: int, idle_s: float, as_json: bool) -> int:
    """Serve POLICY by openpi's protocol until Ctrl-C: a websocket, GET /healthz, GET /metrics.

    Each client has a policy of its own. Where OPENPI_API_KEY is set, clients must send that key. What is sent and
    answered is in docs/policies.md.
    """
    if choose("policy", policy).privileged:
        raise UserError(
            f"{policy} reads the simulator itself, which no client can send: it cannot be served. "
            f"These can: {', '.join(_servable())}."
        )
    if not host:
        raise UserError("--host is empty. 127.0.0.1 is this machine, 0.0.0.0 lets other machines in.")
    from mpvi_bt.remote.connection import KEY, key_of_environment
    from mpvi_bt.remote.server import PolicyServer
    from mpvi_bt.suite.policies import for_clients

    make = for_clients(policy, seed, settings)
    make({})  # what cannot be made is told now, not to the first client
    try:
        status, key = Status(), key_of_environment()
    except PolicyError as error:
        raise UserError(f"{error}: no client could send it.") from None
    if not key and host not in ("127.0.0.1", "::1", "localhost"):
        status.say(f"{KEY} is not set: whoever reaches this machine may use it")
    server = PolicyServer(policy, make, key, status.say, idle_s)
    try:
        asyncio.run(_until_stopped(server, host, port, status, as_json))
    except OSError as error:
        raise UserError(f"cannot listen at {host}:{port}: {_reason(error)}") from None
    return 0


def _reason(error: OSError) -> str:
    """Without the address, which asyncio repeats."""
    return (os.strerror(error.errno) if error.errno and error.errno > 0 else error.strerror or str(error)).lower()


async def _until_stopped(server: PolicyServer, host: str, port: int, status: Status, as_json: bool) -> None:
    """Serve until Ctrl-C, or a request to end."""
    stop, loop = asyncio.Event(), asyncio.get_running_loop()

    def end(number: int, frame: object) -> None:
        for again in _ENDS:  # ending does not take long, and has an exit code of its own
            signal.signal(again, signal.SIG_IGN)
        loop.call_soon_threadsafe(stop.set)

    for number in _ENDS:
        signal.signal(number, end)
    async with server.listening(host, port):
        address = f"ws://{f'[{host}]' if ':' in host else host}:{server.port}"
        status.say(f"serving {server.name} at {address}; Ctrl-C ends it")
        if as_json:
            click.echo(json.dumps({"policy": server.name, "address": address, "port": server.port}))
            sys.stdout.flush()
        while not stop.is_set():
            status.draw(server)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(stop.wait(), EVERY_S)
        status.clear()
    if as_json:
        counts = server.metrics
        told = {"clients": counts.connections, "answers": counts.inferences, "errors": dict(counts.errors)}
        click.echo(json.dumps(told))
    status.say(f"ended: {server.metrics.summary()}")


class Status:
    """What a person sees on stderr: lines that stay, and on a terminal one below that is drawn anew."""

    def __init__(self) -> None:
        self._live, self._drawn = sys.stderr.isatty(), ""

    def say(self, line: str) -> None:
        """A line that stays."""
        self.clear()
        click.echo(f"mpvi: {line}", err=True)

    def draw(self, server: PolicyServer) -> None:
        """How the server stands."""
        line = one_line(server.metrics.summary())[: shutil.get_terminal_size().columns - 1]
        if self._live and line != self._drawn:
            draw(sys.stderr, f"\r\x1b[2K{line}")
            self._drawn = line

    def clear(self) -> None:
        """Take the drawn line away."""
        if self._drawn:
            draw(sys.stderr, "\r\x1b[2K")
            self._drawn = ""
