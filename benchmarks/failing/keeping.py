"""Keeps a table of the study as `benchmarks/results/NAME.json`, for `make results`."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Sequence
from typing import Any

import click

from benchmarks.collecting import processor
from benchmarks.origin import Run
from benchmarks.tables import RESULTS, Cell, Column, Table
from mpvi_bt.ground.errors import UserError


def keeping(command: Callable[..., Any]) -> Any:
    """The options that keep what a command finds; bad input is one line."""

    @functools.wraps(command)
    def told(**given: Any) -> None:
        try:
            command(**given)
        except UserError as error:
            raise click.UsageError(str(error)) from None

    for option in (
        click.option("--settings", default="", help="What has a bearing on the figures and is not in the command."),
        click.option("--date", help="Of the episodes, YYYY-MM-DD."),
        click.option("--commit", help="That the episodes were played at."),
        click.option("--command", help="What played the episodes and made the table, as it was typed."),
        click.option("--keep", metavar="NAME", help="Keep the table as benchmarks/results/NAME.json."),
    ):
        told = option(told)
    return told


def tell(
    columns: Sequence[Column],
    rows: Sequence[Sequence[Cell]],
    keep: str | None,
    command: str | None,
    commit: str | None,
    date: str | None,
    settings: str,
) -> None:
    """Print a table; keep it under a name, if there is one.

    Raises:
        UsageError: It is to be kept, and the command or the date is not said.
    """
    if keep and not (command and date):
        raise click.UsageError("--keep needs --command and --date.")
    run = Run(
        command=command or "not kept",
        commit=commit,
        date=date or "1970-01-01",
        processor=processor(),
        settings=settings,
    )
    table = Table(kind="table", runs=(run,), columns=tuple(columns), rows=tuple(map(tuple, rows)))
    click.echo(table.render().rpartition("\n\n")[0])
    if keep:
        data = table.model_dump(exclude_defaults=True, mode="json")
        lines = ",\n".join(f"    {json.dumps(row)}" for row in data.pop("rows"))
        head = json.dumps({"kind": "table", **data}, indent=2)[:-2]
        RESULTS.joinpath(f"{keep}.json").write_text(f'{head},\n  "rows": [\n{lines}\n  ]\n}}\n', encoding="utf-8")
