"""`mpvi schema`: what editors need to complete trees and rules, and to underline mistakes."""

from __future__ import annotations

import click


@click.command()
@click.argument("what", type=click.Choice(["tree", "rules"]), default="tree")
def schema(what: str) -> None:
    """Print the JSON Schema of trees, with the nodes of every installed package, or of substitution rules.

    A tree names it in its first line: "# yaml-language-server: $schema=schema/tree.json", a path from where it lies.
    """
    from mpvi_bt.tree.json_schema import schema_text

    click.echo(schema_text(what), nl=False)
