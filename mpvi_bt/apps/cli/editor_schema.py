"""`mpvi schema`: what editors need to complete trees and rules, and to underline mistakes."""

from __future__ import annotations

from pathlib import Path

import click

from mpvi_bt.executive.drawing.terminal import tell


@click.command()
@click.argument("what", type=click.Choice(["tree", "rules"]), default="tree")
@click.option(
    "--nodes", multiple=True, metavar="FILE", help="Nodes of your own: my_nodes.py, or my_nodes:Blink. Can be repeated."
)
def schema(what: str, nodes: tuple[str, ...]) -> None:
    """Print the JSON Schema of trees, with the nodes of every installed package, or of substitution rules.

    A tree names it in its first line: "# yaml-language-server: $schema=schema/tree.json", a path from where it lies.
    """
    from mpvi_bt.executive.behaviors.own_nodes import own_nodes
    from mpvi_bt.executive.tree.json_schema import schema_text

    if nodes and what != "tree":
        raise click.UsageError("--nodes is of the schema of trees.")
    own = [node for given in nodes for node in own_nodes(Path(given).name, Path(given).parent)]
    tell(schema_text(what, own), nl=False)
