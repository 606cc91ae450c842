"""How extras are installed: what messages and documents say works before anything is published."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from mpvi_bt import __version__
from mpvi_bt.ground.extras import install

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
HOME = ROOT / "mpvi_bt" / "extras.py"
TEXTS = [
    ROOT / "README.md",
    *(ROOT / "docs").glob("*.md"),
    *(path for folder in ("mpvi_bt", "examples", "benchmarks", "tests") for path in (ROOT / folder).rglob("*.py")),
]
OURS = re.compile(r"pip install [^\n`]*?(?P<what>'[^'\n]*\[[\w,-]+\]')")


def test_nothing_says_to_install_what_no_index_has() -> None:
    """Where an extra of ours is to be installed it comes from the clone, or from a wheel of this version made of it."""
    places = (".", f"dist/mpvi_bt-{__version__}-py3-none-any.whl")
    for path in TEXTS:
        for found in OURS.finditer(path.read_text(encoding="utf-8")) if path not in (HOME, Path(__file__)) else ():
            place, _, extra = found["what"].strip("'").removesuffix("]").partition("[")
            assert place in places, f"{path}: {found.group()}"
            assert extra in PROJECT["optional-dependencies"]


def test_messages_name_extras_that_there_are() -> None:
    """Wherever the one home of that text is asked."""
    asked = {
        name
        for path in TEXTS
        for name in re.findall(r"\binstall\([\"']([\w-]+)[\"']\)", path.read_text(encoding="utf-8"))
    }
    assert asked
    assert asked <= set(PROJECT["optional-dependencies"])


def test_the_command_works_from_anywhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the clone it is the short one of the documents; elsewhere it names the clone."""
    monkeypatch.chdir(ROOT)
    assert install("rerun") == "pip install -e '.[rerun]'"
    monkeypatch.chdir(tmp_path)
    assert install("rerun") == f"pip install -e '{ROOT}[rerun]'"


@pytest.mark.parametrize("where", [".[benchmarks]", f"{ROOT}[benchmarks]"])
def test_pip_reads_what_is_said(where: str) -> None:
    """Its own parser takes the words for the clone with an extra."""
    code = (
        "import sys\nfrom pip._internal.req.constructors import parse_editable\n"
        "name, url, extras = parse_editable(sys.argv[1])\nprint(url, *extras)"
    )
    done = subprocess.run([sys.executable, "-c", code, where], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == f"file://{ROOT} benchmarks\n"
