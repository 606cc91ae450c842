"""mpvi compile and render."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from mpvi_bt.apps.cli.check import check
from mpvi_bt.apps.cli.compile_plan import compile_
from mpvi_bt.apps.cli.render import render
from mpvi_bt.executive.tree.yaml_io import load_tree
from mpvi_bt.ground.errors import MpviError

RUN = CliRunner()


def test_compiled_trees_check_and_render(tmp_path: Path) -> None:
    """What compile writes, check passes and render draws."""
    out = tmp_path / "tree.yaml"
    assert RUN.invoke(compile_, ["picking_up_trash", "--out", str(out)]).output == ""
    assert out.read_text() == RUN.invoke(compile_, ["picking_up_trash"]).output
    assert RUN.invoke(check, [str(out)], standalone_mode=False).return_value == 0
    drawn = RUN.invoke(render, [str(out)]).output
    assert drawn == RUN.invoke(render, ["picking_up_trash"]).output
    assert len(drawn.splitlines()) == len(load_tree(out).nodes)
    nodes = json.loads(RUN.invoke(render, ["picking_up_trash", "--json"]).output)["nodes"]
    assert [n["path"] for n in nodes] == [n.path for n in load_tree(out).nodes]


@pytest.mark.parametrize(
    ("command", "word"),
    [(compile_, "picking_up_trsh"), (compile_, "none.json"), (render, "pickin"), (render, "x.yaml")],
)
def test_what_is_not_there_is_one_line(command: object, word: str) -> None:
    """An unknown name or file is a user's error, not a traceback."""
    from click import Command

    assert isinstance(command, Command)
    done = RUN.invoke(command, [word], standalone_mode=False)
    assert isinstance(done.exception, MpviError)
    assert (done.exception.exit_code, len(str(done.exception).splitlines())) == (2, 1)
