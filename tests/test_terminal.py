"""Nothing that comes from a file, a model or a server is obeyed by a terminal; our own colors are."""

from __future__ import annotations

import io
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpvi_bt.apps.cli.group import run
from mpvi_bt.executive.drawing.cells import harmless
from mpvi_bt.executive.drawing.terminal import guarded
from mpvi_bt.ground.errors import Problem, UserError, bounded
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.suite.progress import SuiteProgress
from mpvi_bt.runs.suite.schedule import EpisodeTimes
from mpvi_bt.runs.suite.store import Fault

EVIL = "\x1b]0;title\x07 \x1b]8;;http://evil\x1b\\link \x9b38;5;201m \x1b[38;5;201m \u202eback \x1b[2J\rgone \x7f\u2066"
OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
OURS = re.compile(r"\x1b\[(?:\d*[FKJH]|\?(?:1049|25)[hl]|(?:0|1|2|3[0-7])?m)|\r\x1b\[2K")
TREE = """\
tree: evil
about: EVIL
blackboard:
  said: EVIL
root:
  sequence: run
  memory: true
  children:
    - set: said
      value: EVIL
    - fail: nobody_home
"""


class Terminal(io.StringIO):
    """A stream that is one."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def evil(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A root of trees, one of which says EVIL wherever it can, as the folder in which commands run."""
    (tmp_path / "trees").mkdir()
    (tmp_path / "trees/evil.yaml").write_text(TREE.replace("EVIL", json.dumps(EVIL)))
    (tmp_path / f"{EVIL[:4]}.yaml").write_text("tree: [")
    monkeypatch.setenv("MPVI_PATH", str(tmp_path))
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    "command",
    [
        "list trees", "check trees", "check .", "render evil", "render evil --format unicode", "run --dry --tree evil",
        "run --dry --tree evil --step", "run --dry --tree evil --json", "convert trees/evil.yaml -", "fmt -",
        f"run {EVIL}", f"--{EVIL}", "suite status nothing", f"suite run smoke --task {EVIL}",
    ],
)  # fmt: skip
@pytest.mark.parametrize("terminal", [True, False])
def test_what_files_and_words_say_is_not_obeyed(
    command: str, terminal: bool, evil: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a terminal and piped, no command prints an escape sequence, a control or a mark of direction but our own."""
    if command == "fmt -" and not terminal:
        pytest.skip("programs get data as they are")
    out, err = (Terminal(), Terminal()) if terminal else (io.StringIO(), io.StringIO())
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setattr(sys, "stderr", err)
    monkeypatch.setattr(
        sys, "stdin", io.StringIO(TREE.replace("EVIL", json.dumps(EVIL)) if "fmt" in command else "k\ne\n")
    )
    run(command.split(" ", 2 if EVIL in command else -1))
    printed = out.getvalue() + err.getvalue()
    assert len(printed) > 10
    assert not OBEYED.search(OURS.sub("", printed).replace("\r\n", "\n")), printed
    drawn = terminal and command in ("run --dry --tree evil", "run --dry --tree evil --json")
    assert ("\x1b[" in printed) == drawn, "our own colors are there where they should be"


def test_programs_get_data_as_they_are(evil: Path, tmp_path: Path) -> None:
    """What is piped to a program is what the file says, marks of direction and all: only a terminal would obey it."""
    text = "tree: right\nabout: \u202eback\nroot:\n  say: x\n"
    done = subprocess.run(
        [sys.executable, "-m", "mpvi_bt.apps.cli", "fmt", "-"], input=text.encode(), capture_output=True, check=False
    )
    assert done.stdout.decode() == text


@settings(max_examples=50)
@given(
    st.recursive(st.text() | st.none(), lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner), max_leaves=5)
)
def test_json_stays_what_it_is(data: object) -> None:
    """JSON that is made harmless says the same."""
    text = json.dumps(data, ensure_ascii=False)
    assert json.loads(harmless(text)) == data
    assert not OBEYED.search(harmless(text))


@given(st.text())
def test_what_can_be_printed_stays(text: str) -> None:
    """Printable text, line ends, tabs and joined emoji come out as they went in; what is harmless stays so."""
    assert harmless(harmless(text)) == harmless(text)
    kept = "".join(c for c in text if c.isprintable()) + "\n\t\u0645\u0631 👩‍🚀 e\u0301 \u3000"
    assert harmless(kept) == kept


def test_an_encoding_that_lacks_a_sign_gets_its_escape(monkeypatch: pytest.MonkeyPatch) -> None:
    """A terminal without UTF-8 ends no command."""
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr(sys, "stdout", stream)
    with guarded():
        print("ä 不")
    stream.flush()
    assert stream.buffer.getvalue() == b"\\u00e4 \\u4e0d\n"


def test_what_broke_a_worker_is_one_short_line() -> None:
    """An exception's message may be anything."""
    stream = Terminal()
    progress = SuiteProgress(stream, EpisodeTimes({}))
    progress.broke(EpisodeConfig("hello"), Fault(f"OSError: {EVIL}\n" + "x" * 300_000), again=False)
    assert not OBEYED.search(stream.getvalue())
    assert len(stream.getvalue().splitlines()) == 1
    assert len(stream.getvalue()) < 2500


def test_no_message_has_a_long_line(capsys: pytest.CaptureFixture[str]) -> None:
    """The ends of a long line are kept, which say where and what would be valid; the lines between stay as they are."""
    long = "x" * 300_000
    message = str(UserError(f"a.yaml: no\nfile.yaml: {long}. Did you mean 'hello'?"))
    first, second = message.split("\n")
    assert first == "a.yaml: no"
    assert second.startswith("file.yaml: xxx")
    assert second.endswith("Did you mean 'hello'?")
    assert "characters left out" in second
    assert len(second) < 2100
    assert len(Problem("a.yaml", 1, 1, "syntax", long).message) < 2100
    assert bounded("x" * 2000) == "x" * 2000
    run(["run", long])
    run(["run", "--param", long, "--dry", "--tree", "hello"])
    run(["run", "picking_up_trash", f"--{long}"])
    captured = capsys.readouterr()
    assert max(map(len, (captured.out + captured.err).splitlines())) < 2500
