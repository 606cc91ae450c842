"""`mpvi schema`: what editors need to complete tree files and to underline mistakes."""

from __future__ import annotations

import click


@click.command()
@click.argument("what", type=click.Choice(["tree"]), default="tree")
def schema(what: str) -> None:
    """Print the JSON Schema of tree files, with the nodes of every installed package.

    A tree names it in its first line: "# yaml-language-server: $schema=schema/tree.json".
    """
    from mpvi_bt.tree.schema import schema_text

    click.echo(schema_text(), nl=False)
