"""`mpvi explain` and `mpvi diff`: why a recorded run ended as it did, and where two of them part."""

from __future__ import annotations

import dataclasses
import json

import click

from mpvi_bt.apps.cli.argument_types import File
from mpvi_bt.executive.drawing.terminal import tell
from mpvi_bt.executive.trace.diff import diff, difference_text
from mpvi_bt.executive.trace.explain import explain
from mpvi_bt.executive.trace.explain_text import explanation_text
from mpvi_bt.executive.trace.read import read_trace


@click.command(name="explain")
@click.argument("trace", type=File(), metavar="TRACE")
@click.option("--json", "as_json", is_flag=True, help="For programs: the chain of causes as one JSON object.")
def explain_(trace: str, as_json: bool) -> None:
    """Say why a recorded run ended as it did, from the root down to the leaf.

    TRACE is a file that `mpvi run` wrote beside its result, NAME.trace.jsonl.
    """
    explanation = explain(read_trace(trace))
    tell(json.dumps(dataclasses.asdict(explanation), indent=2) if as_json else explanation_text(explanation))


@click.command(name="diff")
@click.argument("a", type=File(), metavar="TRACE")
@click.argument("b", type=File(), metavar="TRACE")
@click.option("--json", "as_json", is_flag=True, help="For programs: the difference as one JSON object.")
def diff_(a: str, b: str, as_json: bool) -> int:
    """Show the first tick at which two recorded runs part.

    Wall time is not compared. Exit code 0 where the runs are the same, 1 where they differ.
    """
    difference = diff(read_trace(a), read_trace(b))
    if as_json:
        tell(json.dumps({"same": difference.same, **dataclasses.asdict(difference)}, indent=2))
    else:
        tell(difference_text(difference, (a, b)))
    return 0 if difference.same else 1
