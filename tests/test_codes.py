"""docs/codes.md names every problem, and shows what `mpvi check` prints."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from pathlib import Path

from click.testing import CliRunner

import mpvi_bt
from mpvi_bt.apps.authoring.checking import problems_in
from mpvi_bt.apps.cli.check import check
from mpvi_bt.ground.marked_yaml import _CODES
from tests.test_broken_files import OPERATORS, mutants

PACKAGE = Path(mpvi_bt.__file__).parent
PAGE = (PACKAGE.parent / "docs" / "codes.md").read_text()
LISTED = re.findall(r"^\| `([a-z-]+)` \|", PAGE, re.MULTILINE)
ELSEWHERE = ("btcpp/*.py", "trace/*.py")  # have pages of their own
SAYS = {"problem", "_problem", "_refuse", "_stop", "stop", "head"}  # methods
MAKES = {"Problem", "_doubted"}  # functions
# Looked up by names that are no literals, in `check_task` and `value_problems`.
LOOKED_UP = {"problem", "house", "plan", "tree", "policy-settings", "backend"}


def said() -> Iterator[str]:
    """Every code that the package's source gives to a problem."""
    yield from {*_CODES.values(), "wrong-type", "invalid-value"}
    yield from (f"unknown-{name}" for name in LOOKED_UP)
    for path in PACKAGE.rglob("*.py"):
        if not any(path.match(pattern) for pattern in ELSEWHERE):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Call):
                    name = node.func.attr if isinstance(node.func, ast.Attribute) else ""
                    says = name in SAYS or getattr(node.func, "id", "") in MAKES
                    texts = [a.value for a in node.args if isinstance(a, ast.Constant) and isinstance(a.value, str)]
                    codes = [text for text in texts if re.fullmatch(r"[a-z]+(-[a-z]+)*", text)]
                    if name == "unknown" and texts:
                        yield f"unknown-{texts[0].replace(' ', '-')}"
                    elif says and codes:
                        yield codes[-1]


def test_every_code_is_listed_once() -> None:
    """What the source says is in the page, and what is in the page is said."""
    assert len(set(LISTED)) == len(LISTED)
    assert set(said()) == set(LISTED)


def test_what_broken_files_get_is_listed(tmp_path: Path) -> None:
    """No code comes about in another way."""
    found = set()
    for i, mutant in enumerate([one for operator in OPERATORS for one in mutants(operator)][::5]):
        path = tmp_path / str(i) / mutant.file.parent.name / mutant.file.name
        path.parent.mkdir(parents=True)
        path.write_text(mutant.text)
        found |= {p.code for p in problems_in(str(path))}
    assert found <= set(LISTED)
    assert len(found) > 15


def test_the_example_is_true(tmp_path: Path) -> None:
    """The page shows what check prints of a small tree, for people and for programs."""
    (tmp_path / "trees").mkdir()
    path = tmp_path / "trees" / "t.yaml"
    path.write_text("tree: t\nroot:\n  navigate: cup\n  rom: kitchen\n")
    printed = CliRunner().invoke(check, [str(path)], standalone_mode=False).stdout.replace(f"{tmp_path}/", "")
    assert "".join(f"    {line}\n" for line in printed.splitlines()) in PAGE
    found = json.loads(CliRunner().invoke(check, [str(path), "--json"], standalone_mode=False).stdout)
    found["problems"][0]["file"] = "trees/t.yaml"
    shown = re.search(r"```json\n(.*?)```", PAGE, re.DOTALL)
    assert shown is not None
    assert json.loads(shown[1]) == found
