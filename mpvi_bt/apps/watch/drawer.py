"""Draws the texts of an edited tree in its own process, and ends it as soon as a text is outdated."""

from __future__ import annotations

import contextlib
import html
import json
import subprocess
import sys
import tempfile
from pathlib import Path

from mpvi_bt.executive.drawing.cells import one_line
from mpvi_bt.executive.trace.html import digest, page_style


class Drawer:
    """Hands texts of one file to a process that makes pages of dry runs, one after another.

    So a dry run takes no time from the check of the next text, and one that is outdated none at all.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._process: subprocess.Popen[str] | None = None
        self._busy = False

    def draw(self, text: str) -> str | None:
        """The page of a text; None if it was stopped, or could not be made."""
        process = self._process or self._started()
        assert process.stdin is not None
        assert process.stdout is not None
        self._busy = True
        try:
            process.stdin.write(json.dumps(text) + "\n")
            process.stdin.flush()
            line = process.stdout.readline()
        except (OSError, ValueError):  # it has ended, or was closed
            line = ""
        self._busy = False
        if not line:
            self._end(process)
        return json.loads(line) if line else None

    def stop(self) -> None:
        """Give up the present drawing, and prepare another process for the next one."""
        if self._busy and self._process is not None:
            self._process.kill()  # an end of its own would take seconds where the cores are busy
            self._started()

    def close(self) -> None:
        """End the process, and remove its files."""
        if self._process is not None:
            self._process.kill()
            self._end(self._process)
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None

    def _started(self) -> subprocess.Popen[str]:
        if self._folder is None:  # made and removed here: a process that is killed cannot remove its files
            self._folder = tempfile.TemporaryDirectory(prefix="mpvi-dry-")
        self._process = subprocess.Popen(
            [sys.executable, "-m", "mpvi_bt.apps.watch.dry_page", str(self._path), self._folder.name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            encoding="utf-8",
            start_new_session=True,  # Ctrl-C is for the server; this ends when its input does
        )
        return self._process

    def _end(self, process: subprocess.Popen[str]) -> None:
        """Let go of a process that has ended, or is about to."""
        with contextlib.suppress(OSError):
            process.__exit__(None, None, None)
        if self._process is process:
            self._process = None


def sentence(text: str) -> str:
    """A page that says only this."""
    style = page_style()
    policy = f"default-src 'none'; style-src '{digest(style)}'"
    head = f'<!doctype html><meta charset="utf-8"><meta http-equiv="Content-Security-Policy" content="{policy}">'
    return f"{head}<style>{style}</style><header><p>{html.escape(one_line(text))}</p></header>"
