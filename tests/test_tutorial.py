"""The tutorial is what a reader gets: its files are written, its commands run, and they print what stands there.

`python -m tests.test_tutorial` runs it, and writes what the commands print into its two pages; with names, runs those
pages one by one.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "docs" / name for name in ("tutorial.md", "tutorial_failures.md")]
SEAM = "\n=== the next page goes on in the same folder ===\n"
BLOCK = re.compile(
    r"`([\w./]+)`:\n\n```(?:yaml|lisp|python)\n(.*?)^```$|^```console\n(.*?)^```$", flags=re.MULTILINE | re.DOTALL
)
HOUSE = "## In the house"
MARK = "=== a command ends here ==="


def play(text: str, folder: Path) -> str:
    """The text with what its commands print, run in order in one shell that starts in `folder`.

    On a machine where loops had to be compiled first, a line says so: the text is then played again, as a page shows
    what every later run prints.
    """
    played = play_once(text, folder)
    if "mpvi: compiling loops for this machine" not in played:
        return played
    again = folder / "again"
    again.mkdir()
    return play_once(text, again)


def play_once(text: str, folder: Path) -> str:
    """The text with what its commands print this time."""
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


def whole(pages: Sequence[Path]) -> str:
    """Pages that are read in turn, as one text."""
    return SEAM.join(page.read_text(encoding="utf-8") for page in pages)


def commands(console: str) -> list[str]:
    """Those of a block."""
    return [line.removeprefix("$ ") for line in console.splitlines() if line.startswith("$ ")]


@pytest.mark.rare
def test_the_tutorial_is_true_without_a_simulator(tmp_path: Path) -> None:
    """Everything before the house prints what stands there, character by character."""
    text = whole(PAGES).partition(HOUSE)[0]
    assert play(text, tmp_path) == text


@pytest.mark.rare
@pytest.mark.slow
@pytest.mark.render
def test_the_tutorial_is_true_in_the_house(tmp_path: Path) -> None:
    """The whole of it, the run in the house too."""
    text = whole(PAGES)
    assert play(text, tmp_path) == text


if __name__ == "__main__":
    for pages in [[Path(given)] for given in sys.argv[1:]] or [PAGES]:
        with tempfile.TemporaryDirectory() as empty:
            played = play(whole(pages), Path(empty)).split(SEAM)
        for page, text in zip(pages, played, strict=True):
            page.write_text(text, encoding="utf-8")
