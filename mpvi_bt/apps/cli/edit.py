"""`mpvi edit`: a tree in a browser, with its problems and a dry run, as it changes."""

from __future__ import annotations

import asyncio
from pathlib import Path

import click

from mpvi_bt.apps.cli import INTERRUPTED
from mpvi_bt.apps.cli.argument_types import serve as serving
from mpvi_bt.apps.cli.watch import require_server
from mpvi_bt.apps.watch.address import Address
from mpvi_bt.ground.errors import UserError


@click.command()
@click.argument("tree", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE")
@serving
def edit(tree: Path, serve: Address | None) -> int:
    """Serve a page with the tree in FILE, its problems, its drawing and a dry run, until Ctrl-C.

    Whatever editor changes the file, the page follows; it can change and save it, too.
    """
    require_server()
    from mpvi_bt.apps.watch.edited_tree import Edited
    from mpvi_bt.apps.watch.page_server import Server

    if not tree.is_file():
        raise UserError(f"{tree}: no such file; `mpvi new tree NAME` writes one to begin with")
    edited = Edited(tree)
    bound = (serve or Address()).bound()
    click.echo(f"mpvi: edit it at {bound.url}; Ctrl-C ends it", err=True)
    try:
        server = Server(edited.app, bound.listener, bound.token, stopping=edited.close)
        asyncio.run(server.serve())
    except KeyboardInterrupt:
        return INTERRUPTED
    return 0
