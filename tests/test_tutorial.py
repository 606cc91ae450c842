"""The tutorial is what a reader gets: its files are written, its commands run, and they print what stands there.

`python -m tests.test_tutorial` runs it, or the pages that are named, and writes what the commands print into it.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FILE = ROOT / "docs" / "tutorial.md"
BLOCK = re.compile(
    r"`([\w./]+)`:\n\n```(?:yaml|lisp|python)\n(.*?)^```$|^```console\n(.*?)^```$", flags=re.MULTILINE | re.DOTALL
)
HOUSE = "## In the house"
MARK = "=== a command ends here ==="


def play(text: str, folder: Path) -> str:
    """The text with what its commands print, run in order in one shell that starts in `folder`."""
    script = []
    for block in BLOCK.finditer(text):
        path, content, console = block.groups()
        if path:
            script.append(f"cat > {path} <<'END OF FILE'\n{content}END OF FILE\n")
        else:
            script += [f"{{ {command}; }} 2>&1\necho '{MARK}'\n" for command in commands(console)]
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "COLUMNS": "80"}
    environment.pop("MPVI_PATH", None)
    done = subprocess.run(
        ["bash", "-c", "".join(script)], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    printed = iter(done.stdout.split(f"{MARK}\n"))

    def with_output(block: re.Match[str]) -> str:
        if block[1]:
            return block.group()
        return "```console\n" + "".join(f"$ {command}\n{next(printed)}" for command in commands(block[3])) + "```"

    return BLOCK.sub(with_output, text)


def commands(console: str) -> list[str]:
    """Those of a block."""
    return [line.removeprefix("$ ") for line in console.splitlines() if line.startswith("$ ")]


@pytest.mark.rare
def test_the_tutorial_is_true_without_a_simulator(tmp_path: Path) -> None:
    """Everything before the house prints what stands there, character by character."""
    text = FILE.read_text(encoding="utf-8").partition(HOUSE)[0]
    assert play(text, tmp_path) == text


@pytest.mark.rare
@pytest.mark.slow
@pytest.mark.render
def test_the_tutorial_is_true_in_the_house(tmp_path: Path) -> None:
    """The whole of it, the run in the house too."""
    text = FILE.read_text(encoding="utf-8")
    assert play(text, tmp_path) == text


if __name__ == "__main__":
    for page in [Path(given) for given in sys.argv[1:]] or [FILE]:
        with tempfile.TemporaryDirectory() as empty:
            page.write_text(play(page.read_text(encoding="utf-8"), Path(empty)), encoding="utf-8")
