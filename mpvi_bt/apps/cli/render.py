"""`mpvi render`: a tree, or the tree of a trace at one of its ticks, drawn from its file alone."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from mpvi_bt.apps.cli.argument_types import File, arguments
from mpvi_bt.apps.cli.setting_options import parameters
from mpvi_bt.executive.drawing.cells import WIDEST, WIDTH
from mpvi_bt.executive.drawing.terminal import give, results, size
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.writing import write_whole

if TYPE_CHECKING:  # what they load is slower than the help of this command should be
    from mpvi_bt.executive.trace.read import Trace
    from mpvi_bt.executive.tree.spec import TreeSpec
    from mpvi_bt.executive.tree.state import NodeState


Format = Literal["ascii", "unicode", "dot", "svg", "html"]
_SUFFIXES: dict[str, Format] = {
    ".txt": "ascii", ".dot": "dot", ".gv": "dot", ".svg": "svg", ".html": "html", ".htm": "html",
}  # fmt: skip


@dataclass(frozen=True)
class _Drawing:
    """What is drawn.

    Attributes:
        tree: The tree, of a trace the one that was ticked.
        states: By path; None: nothing has run.
        when: One line: when in the run this is, and how it ended if it did; "" of a tree.
        tick: Of the run.
        trace: The whole of it.
    """

    tree: TreeSpec
    states: dict[str, NodeState] | None = None
    when: str = ""
    tick: int | None = None
    trace: Trace | None = None


@click.command()
@click.argument("tree", type=File("trees"), metavar="TREE|TRACE")
@click.option(
    "--format",
    "form",
    type=click.Choice(["ascii", "unicode", "dot", "svg", "html"]),
    help="Text (ascii, the default, or unicode), Graphviz, a picture, or a page to fold and play. "
    "Left out, it is told by the suffix of --out.",
)
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), help="Write here instead of to the terminal.")
@click.option(
    "--width", type=click.IntRange(20, 1000), help="Columns of text.  [default: the terminal's, up to 120, or 80]"
)
@parameters
@click.option("--tick", type=click.IntRange(min=0), help="Tick of a trace to draw.  [default: the last]")
@click.option("--json", "as_json", is_flag=True, help="For programs: every node with its path, depth and state.")
def render(
    tree: str,
    form: Format | None,
    out: Path | None,
    width: int | None,
    params: tuple[str, ...],
    tick: int | None,
    as_json: bool,
) -> None:
    """Draw a tree, or where the run of a trace stands.

    TREE is a file, - for the standard input, or the name of a tree, yours in MPVI_PATH or one that comes with mpvi_bt.
    TRACE is a .jsonl file that a run left.

    Before a node stands {-} for a sequence and {o} for a selector that remember which child ran, [-] and [o] for those
    that begin anew at every tick, /_/ for children side by side, -^- for a decorator, --> for a leaf; behind it, of a
    run, how it stands: [*] running, [o] success, [x] failure, [!] gave up, [/] interrupted, [-] not begun.
    """
    if as_json and form:
        raise click.UsageError("--json and --format exclude each other.")
    form = form or (_guessed(out) if out and not as_json else "ascii")
    picture = _picture(tree, tick, arguments(params))
    if width is None:
        width = min(size().columns, WIDEST) if out is None and results().isatty() else WIDTH
    text = json.dumps(_described(picture), indent=2) if as_json else _drawn(picture, form, width)
    if out is None:
        give(text + "\n")
        return
    write_whole(out, text + "\n")


def _guessed(out: Path) -> Format:
    if out.suffix.lower() not in _SUFFIXES:
        raise UserError(f"{out}: its suffix tells no format. Known: {', '.join(_SUFFIXES)}; or give --format.")
    return _SUFFIXES[out.suffix.lower()]


def _picture(given: str, tick: int | None, values: dict[str, str]) -> _Drawing:
    """Raises UserError, FileProblems."""
    if not given.endswith(".jsonl"):
        from mpvi_bt.executive.tree.yaml_io import load_tree, parse_tree

        if tick is not None:
            raise UserError(f"{given}: --tick needs the trace of a run, a .jsonl file, not a tree.")
        if given == "-":
            return _Drawing(parse_tree(sys.stdin.read(), "<stdin>", arguments=values))
        return _Drawing(load_tree(paths.find_or_file("trees", given, "tree"), arguments=values))

    from mpvi_bt.executive.trace.read import read_trace

    if values:
        raise UserError(f"{given}: the tree of a run has its parameters filled in already; --param is for trees.")

    trace = read_trace(given)
    at = trace.last_tick if tick is None else tick
    trace.require_tick(at)
    i = trace.index_at(at)
    when = f"tick {tick}, {trace.time_at(at):.1f} s"
    if tick is None:
        when = trace.told
    return _Drawing(trace.tree_at(i) if i >= 0 else trace.tree, trace.states_at(at), when, at, trace)


def _drawn(picture: _Drawing, form: Format, width: int) -> str:
    if form == "dot":
        from mpvi_bt.executive.drawing.dot import dot_tree

        return dot_tree(picture.tree, picture.states)
    if form == "svg":
        from mpvi_bt.executive.drawing.svg import svg_tree

        return svg_tree(picture.tree, picture.states)
    if form == "html":
        from mpvi_bt.executive.trace.html import trace_page, tree_page

        return trace_page(picture.trace, picture.tick) if picture.trace else tree_page(picture.tree)

    from mpvi_bt.executive.drawing.text import ascii_tree, unicode_tree, where

    lines = [(ascii_tree if form == "ascii" else unicode_tree)(picture.tree, picture.states, width)]
    if picture.states is not None:
        lines += filter(None, [where(picture.tree, picture.states, width), picture.when])
    return "\n".join(lines)


def _described(picture: _Drawing) -> dict[str, Any]:
    nodes = [
        {
            "path": n.path,
            "depth": n.depth,
            "kind": n.spec.kind,
            "label": n.spec.label,
            "segments": n.spec.segments,
            **n.spec.parameters.model_dump(),
            **({"state": vars(picture.states[n.path])} if picture.states and n.path in picture.states else {}),
        }
        for n in picture.tree.nodes
    ]
    tree = {"tree": picture.tree.name, "instruction": picture.tree.instruction, "nodes": nodes}
    return tree if picture.tick is None else {"tick": picture.tick, "when": picture.when, **tree}
