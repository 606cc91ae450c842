"""The keywords of `mpvi_bt.run` as type checkers see them: `python -m tests.setting_keywords` writes the file."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path

import mpvi_bt
from mpvi_bt.runs.choices.config import ONE_EPISODES, SETTINGS, SHARED, EpisodeConfig

FILE = Path(mpvi_bt.__file__).parent / "runs" / "choices" / "setting_keywords.py"
OWN = ("tree", "plan")  # parameters by themselves, which take more than names
HEAD = '''\
"""Keywords of `mpvi_bt.run` and `mpvi_bt.run_suite` for type checkers, made of the fields of `EpisodeConfig`.

Not edited by hand: `python -m tests.setting_keywords` writes it.
"""

from __future__ import annotations

from os import PathLike
from typing import Literal, TypedDict

File = str | PathLike[str]


class SuiteKeywords(TypedDict, total=False):
    """What the episodes of a suite may have in common."""

'''
BETWEEN = '''

class EpisodeKeywords(SuiteKeywords, total=False):
    """What one episode may be told."""

'''


def text() -> str:
    """The file as it is to be."""
    return HEAD + _lines(SHARED) + BETWEEN + _lines(ONE_EPISODES)


def _lines(names: Iterable[str]) -> str:
    written = {field.name: str(field.type).replace("'", '"') for field in fields(EpisodeConfig)}
    types = {name: re.sub(r"\bPath\b", "File", kind) for name, kind in written.items()}
    return "".join(f"    {name}: {types[name]}\n" for name in names if name in SETTINGS and name not in OWN)


if __name__ == "__main__":
    FILE.write_text(text(), encoding="utf-8")
