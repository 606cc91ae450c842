"""`mpvi watch`: the page of a run or a suite that goes on, or is over, until Ctrl-C."""

from __future__ import annotations

import asyncio
import importlib.util
from pathlib import Path

import click

from mpvi_bt.apps.cli import INTERRUPTED
from mpvi_bt.apps.cli.argument_types import serve as serving
from mpvi_bt.apps.watch.address import Address
from mpvi_bt.ground.errors import UserError


@click.command()
@click.argument("what", type=click.Path(path_type=Path), metavar="TRACE|FOLDER")
@serving
def watch(what: Path, serve: Address | None) -> int:
    """Serve a page that shows a run or a suite while it goes on, until Ctrl-C.

    TRACE is the .jsonl file that a run writes, by `mpvi run` here or elsewhere; FOLDER is that of a suite's results.
    The page is at 127.0.0.1, where only this machine reaches it. With another HOST it wants the token that is part of
    the address printed.
    """
    require_server()
    from mpvi_bt.apps.watch.page_server import Server
    from mpvi_bt.apps.watch.watched import watched
    from mpvi_bt.runs.suite.manifest import FILE

    if not what.exists():
        raise UserError(f"{what}: no such file or folder")
    if what.is_dir() and not (what / FILE).is_file():
        raise UserError(f"{what}: neither a trace nor a folder with results of a suite")
    bound = (serve or Address()).bound()
    watching = watched(what)
    click.echo(f"mpvi: watch it at {bound.url}; Ctrl-C ends it", err=True)
    try:
        asyncio.run(Server(watching.app, bound.listener, bound.token).serve())
    except KeyboardInterrupt:
        return INTERRUPTED
    return 0


def require_server() -> None:
    """Raises UserError if what serves pages is not installed."""
    if not all(map(importlib.util.find_spec, ("starlette", "uvicorn"))):
        from mpvi_bt.ground.extras import install

        raise UserError(f"pages need starlette and uvicorn: {install('live')}")
