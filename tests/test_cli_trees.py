"""mpvi compile, render, check."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from mpvi_bt import paths
from mpvi_bt.cli.trees import check, compile_, render
from mpvi_bt.errors import MpviError
from mpvi_bt.tree.yaml_io import load_tree

ROOT = paths.shipped()
RUN = CliRunner()
SHIPPED = [
    *(ROOT / "trees").rglob("*.yaml"),
    *(ROOT / "skills").rglob("*.yaml"),
    *(ROOT / "tasks").rglob("*.yaml"),
    *(ROOT / "tasks/plans").glob("*.json"),
]


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


def test_everything_shipped_passes_check() -> None:
    """Trees, skills, plans, tasks, suites, houses and the catalogue that come with the package have no problems."""
    assert SHIPPED
    done = RUN.invoke(check, list(map(str, SHIPPED)), standalone_mode=False)
    assert (done.return_value, done.stdout) == (0, "")


def test_check_lists_the_problems_of_all_files(tmp_path: Path) -> None:
    """Each file's problems come with their places, as text and as JSON, and the exit code is 1."""
    (tmp_path / "a.yaml").write_text("tree: t\nroot:\n  navigat: x\n")
    (tmp_path / "b.json").write_text('{"task_name": "t", "segments": []}')
    (tmp_path / "c.yaml").write_text("hello: 1\n")
    files = [str(tmp_path / name) for name in ("a.yaml", "b.json", "c.yaml", "d.yaml")]
    done = RUN.invoke(check, files, standalone_mode=False)
    assert done.return_value == 1
    assert [line.removeprefix(str(tmp_path)).split(": ")[0] for line in done.stdout.splitlines()] == [
        "/a.yaml:3:3",
        "/b.json:1:32",
        "/c.yaml:1:1",
        "/d.yaml",
    ]
    found = json.loads(RUN.invoke(check, [*files, "--json"], standalone_mode=False).stdout)
    assert [p["code"] for p in found] == ["unknown-node", "too-short", "unknown-file", "unreadable"]


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
