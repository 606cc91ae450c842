"""The process that draws an edited tree: `python -m mpvi_bt.apps.watch.dry_page FILE FOLDER`.

It reads texts of the file and writes pages, both as JSON, a line each, until its input ends. It may be killed at any
time: its files are in a folder of its starter's, which it removes only if its starter has gone.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import sys
import time
from pathlib import Path

from mpvi_bt.apps.watch.drawer import sentence
from mpvi_bt.apps.watch.process import NICE
from mpvi_bt.apps.watch.sketch_page import sketch_page
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.ticking.dry import dry_tree, run_dry
from mpvi_bt.executive.trace.html import trace_page, tree_page
from mpvi_bt.executive.trace.read import read_trace
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.executive.tree.yaml_io import parse_tree
from mpvi_bt.ground.errors import FileProblems, MpviError
from mpvi_bt.ground.standard_streams import keep_stdout
from mpvi_bt.runs.recording.recorder import Recorder

_DRY_S, _DRY_WALL_S = 600.0, 3.0  # simulated and wall time that a dry run may take. Our choice


def drawn(text: str, file: str, folder: str) -> str:
    """A dry run as a page; with errors or open parameters only the tree; if nothing can be drawn, a sentence."""
    try:
        spec = parse_tree(text, file, load_skills())
    except MpviError:
        return _sketch(text, file)
    try:
        return _dry(spec, Path(folder, "dry.trace.jsonl"))
    except MpviError:
        return tree_page(spec)


def _sketch(text: str, file: str) -> str:
    try:
        return sketch_page(text, file)
    except MpviError as error:
        why = error.problems[0].message if isinstance(error, FileProblems) else str(error)
        return sentence(f"There is no drawing: {why}")


def _dry(spec: TreeSpec, trace: Path) -> str:
    end = time.monotonic() + _DRY_WALL_S
    run_dry(dry_tree(spec), load_skills(), [Recorder(trace)], _DRY_S, stop=lambda: time.monotonic() > end)
    return trace_page(read_trace(trace))


def main(file: str, folder: str) -> None:
    """Draw what comes in."""
    pages = keep_stdout()
    sys.stdout = sys.stderr  # what a node prints is no page
    try:
        with contextlib.suppress(BrokenPipeError):
            for line in sys.stdin:
                pages.write(json.dumps(drawn(json.loads(line), file, folder)) + "\n")
                pages.flush()
    finally:
        shutil.rmtree(folder, ignore_errors=True)  # whoever started this is gone


if __name__ == "__main__":
    os.nice(NICE)
    main(sys.argv[1], sys.argv[2])
