"""docs/language.md tells what the source does."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import mpvi_bt
from mpvi_bt.executive.language.exchanges import _FINAL, _PASSING

PACKAGE = Path(mpvi_bt.__file__).parent
PAGE = (PACKAGE.parent / "docs" / "language.md").read_text()


def reasons() -> Iterator[str]:
    """Every code that the source gives a ModelError."""
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("ModelError", "bad"):
                texts = [argument.value for argument in node.args if isinstance(argument, ast.Constant)]
                yield from (text for text in texts if isinstance(text, str) and re.fullmatch(r"[a-z]+_?[a-z]+", text))


def test_every_reason_is_listed_once() -> None:
    """With what happened and how it is mended; what is kept on file is among them."""
    listed = re.findall(r"^\| `([a-z_]+)` \|", PAGE, re.MULTILINE)
    assert len(set(listed)) == len(listed)
    assert set(reasons()) == set(listed)
    assert {*_FINAL, *_PASSING} < set(listed)
