"""`mpvi mcp`: agents plan, check, run and explain trees, over the Model Context Protocol."""

from __future__ import annotations

import asyncio
import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mpvi_bt.apps.cli import INTERRUPTED
from mpvi_bt.apps.cli.argument_types import check_writable, out_folder
from mpvi_bt.apps.cli.argument_types import serve as serving
from mpvi_bt.executive.drawing.terminal import results
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.standard_streams import stdout_given_back

if TYPE_CHECKING:
    from mpvi_bt.apps.watch.address import Address


@click.command()
@serving
@click.option("--allow-motion", is_flag=True, help="Let runs move the robot; without it every run is dry.")
@out_folder("runs/mcp", "A folder below it for each run: its tree, trace and result.")
def mcp(serve: Address | None, allow_motion: bool, out: Path) -> int:
    """Be a server of the Model Context Protocol, on stdin and stdout, or with --serve over HTTP.

    An agent finds nine tools: tasks, scene, plan, check, preview, run, progress, explain, stop. Runs take turns, and
    the trace of each is the record of what was done. docs/agents.md says more.
    """
    try:
        from mpvi_bt.apps.mcp_server.tool_server import make_server
    except ImportError:
        from mpvi_bt.ground.extras import install

        raise UserError(f"the protocol's SDK is not installed: {install('mcp')}") from None
    from mpvi_bt.apps.mcp_server.run_processes import RunProcesses
    from mpvi_bt.apps.mcp_server.tools import Tools

    check_writable(out)
    with contextlib.closing(RunProcesses(out.absolute())) as runs:
        server = make_server(Tools(runs, allow_motion))
        try:
            if serve is None:
                with stdout_given_back(results()):  # the SDK keeps it for the protocol alone
                    server.run("stdio")
            else:
                _over_http(server, serve)
        except KeyboardInterrupt:
            return INTERRUPTED
    return 0


def _over_http(server: Any, serve: Address) -> None:
    from mpvi_bt.apps.mcp_server.tool_server import over_http
    from mpvi_bt.apps.watch.page_server import Server

    bound = serve.bound()
    app = over_http(server)
    click.echo(f"mpvi: MCP at {bound.url.replace('/?', '/mcp?') if bound.token else bound.url + 'mcp'}", err=True)
    asyncio.run(Server(app, bound.listener, bound.token, lifespan=True).serve())
