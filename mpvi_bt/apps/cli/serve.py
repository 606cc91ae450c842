"""`mpvi serve`: a policy, or the whole executive, behind a websocket, until Ctrl-C."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from mpvi_bt.apps.cli.argument_types import BackendType, given_here, out_folder
from mpvi_bt.apps.cli.status import Status
from mpvi_bt.apps.cli.work_options import ELSEWHERE, robot_option, work, work_of
from mpvi_bt.executive.drawing.terminal import tell
from mpvi_bt.ground.errors import PolicyError, UserError
from mpvi_bt.runs.choices.backends import BACKENDS, choose

if TYPE_CHECKING:
    from mpvi_bt.executive.remote.server import SocketServer

EVERY_S = 1.0  # the status line is drawn anew
EXECUTIVE = "mpvi"  # in the place of a policy
_TOLD = (
    "policy_settings",
    "policy_rate",
    "policy_actions",
    "detector",
)  # options that policies and the executive share
_OF_POLICIES = ("what", "host", "port", "seed", "idle_s", *_TOLD, "as_json")
_ENDS = (signal.SIGINT, signal.SIGTERM)


def _complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """The policies that can be served, and the executive."""
    return [CompletionItem(name) for name in (EXECUTIVE, *_servable()) if name.startswith(incomplete)]


def _servable() -> list[str]:
    return [f"{n}:" if b.address else n for n, b in BACKENDS["policy"].items() if not b.privileged]


class _Served(BackendType):
    """A policy, or the executive."""

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """As given. Raises UserError if there is no such policy."""
        return value if value == EXECUTIVE else super().convert(value, param, ctx)


@click.command(context_settings=ELSEWHERE)
@click.argument("what", metavar="POLICY", type=_Served("policy"), shell_complete=_complete)
@click.option(
    "--host",
    default="127.0.0.1",
    show_default=True,
    metavar="ADDRESS",
    help="Address to listen on; 0.0.0.0 for other machines.",
)
@click.option("--port", type=click.IntRange(0, 65535), default=8000, show_default=True, help="Port; 0: any free one.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of everything random.")
@click.option(
    "--idle",
    "idle_s",
    type=click.FloatRange(min=1),
    default=300.0,  # Our choice: longer than a robot drives, or a language model thinks, between two prompts
    show_default=True,
    metavar="SECONDS",
    help="Disconnect a policy's client after this time without a request.",
)
@click.option(
    "--protocol",
    type=click.Choice(["behavior-2025", "behavior-2026", "openpi"]),
    help="Protocol of the executive's clients; policies use openpi's.",
)
@robot_option("Robot of the client, by name or file.", "r1pro")
@work("Task, in place of the observations' task.", "Instruction, in place of the task's.")
@out_folder("runs", "Folder of the executive's results and traces.")
@click.option("--json", "as_json", is_flag=True, help="For programs: the address, and a summary at the end.")
def serve(what: str, host: str, port: int, seed: int, idle_s: float, as_json: bool, **executive: Any) -> int:
    """Serve POLICY by openpi's protocol until Ctrl-C: a websocket, GET /healthz, GET /metrics.

    Each client has a policy of its own. Where OPENPI_API_KEY is set, clients must send that key. What is sent and
    answered is in docs/serving_policies.md.

    The POLICY `mpvi` is the whole executive: a client's observations come in, actions go out, and behind the socket
    the tree is ticked once for each. BEHAVIOR's evaluator, another simulator or a robot's driver can be that client:
    docs/evaluator.md. Options from --protocol to --out are of the executive, but for --policy-settings,
    --policy-rate, --policy-actions and --detector.
    """
    if not host:
        raise UserError("--host is empty. 127.0.0.1 is this machine, 0.0.0.0 lets other machines in.")
    from mpvi_bt.executive.remote.connection import KEY, key_of_environment

    status = Status()
    try:
        key = key_of_environment()
    except PolicyError as error:
        raise UserError(f"{error}: no client could send it.") from None
    if what == EXECUTIVE:
        server = _executive(executive, seed, key, status)
    else:
        told = [executive[name] for name in _TOLD]
        server = _policy(what, told, seed, idle_s, key, status)
    if not key and host not in ("127.0.0.1", "::1", "localhost"):
        status.say(f"{KEY} is not set: whoever reaches this machine may use it")
    try:
        asyncio.run(_until_stopped(server, host, port, status, as_json))
    except BrokenPipeError:  # nobody reads what is printed
        raise
    except OSError as error:
        raise UserError(f"cannot listen at {host}:{port}: {_reason(error)}") from None
    return 0


def _policy(policy: str, told: Sequence[Any], seed: int, idle_s: float, key: str, status: Status) -> SocketServer:
    if own := [p.opts[0] for p in given_here() if p.name not in _OF_POLICIES]:
        raise click.UsageError(f"{own[0]} is of the executive: mpvi serve {EXECUTIVE}.")
    if choose("policy", policy).backend.privileged:
        raise UserError(
            f"{policy} reads the simulator itself, which no client can send: it cannot be served. "
            f"These can: {', '.join(_servable())}."
        )
    from mpvi_bt.executive.remote.policy_server import PolicyServer
    from mpvi_bt.runs.choices.policies import check_pace, for_clients

    settings, rate_hz, kind, detector = told
    check_pace(choose("policy", policy), rate_hz, kind)
    make = for_clients(policy, seed, settings, rate_hz, kind, detector)
    make({})  # what cannot be made is told now, not to the first client
    return PolicyServer(policy, make, key, status.say, idle_s)


def _executive(given: dict[str, Any], seed: int, key: str, status: Status) -> SocketServer:
    from mpvi_bt.runs.serving.served import executive_server

    if (protocol := given.pop("protocol")) is None:
        raise click.UsageError("mpvi serve mpvi wants --protocol: behavior-2025, behavior-2026 or openpi.")
    return executive_server(protocol, work_of(seed=seed, **given), key, status.say)


def _reason(error: OSError) -> str:
    """Without the address, which asyncio repeats."""
    return (os.strerror(error.errno) if error.errno and error.errno > 0 else error.strerror or str(error)).lower()


async def _until_stopped(server: SocketServer, host: str, port: int, status: Status, as_json: bool) -> None:
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
            tell(json.dumps({"policy": server.name, "address": address, "port": server.port}))
        while not stop.is_set():
            status.draw(server.metrics.summary())
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(stop.wait(), EVERY_S)
        status.clear()
    if as_json:
        counts = server.metrics
        told = {"clients": counts.connections, "answers": counts.inferences, "errors": dict(counts.errors)}
        tell(json.dumps(told))
    status.say(f"ended: {server.metrics.summary()}")
