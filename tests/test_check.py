"""`mpvi check`: what it finds, how it shows it, and that no input brings it down."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.apps.authoring.checking import problems_in
from mpvi_bt.apps.cli.check import check
from mpvi_bt.apps.cli.problems import excerpt
from mpvi_bt.executive.drawing.cells import WIDTH, columns
from mpvi_bt.ground import paths
from mpvi_bt.ground.marked_yaml import MAX_PROBLEMS, load_marked

ROOT = paths.shipped()

GOOD = """\
tree: t
parameters:
  object: {type: text, default: cup}
blackboard:
  tries: 0
root:
  sequence: t
  memory: true
  children:
    - timeout: 60
      child:
        retry: 3
        child:
          navigate: $object
          room: kitchen
    - set: tries
      add: 1
    - timeout: 60
      child:
        timeout: 30
        child:
          until_complete:
          children:
            - manipulate: pick up the $object
            - check_complete: the $object is held
    - test: tries
      at_least: 1
"""


def run(*args: str | Path) -> tuple[int, str]:
    """Exit code and output of `mpvi check`."""
    done = CliRunner().invoke(check, list(map(str, args)), standalone_mode=False)
    assert done.exception is None, done.exception
    return done.return_value, done.stdout


def of(tmp_path: Path, text: str) -> list[tuple[int, str, str]]:
    """(line, code, severity) of the problems of a tree."""
    path = tmp_path / "t.yaml"
    path.write_text(text)
    return [(p.line, p.code, p.severity) for p in problems_in(str(path))]


def test_everything_shipped_is_clean() -> None:
    """Trees, skills, plans, tasks, suites, houses and the catalogue have no problems, and no warnings."""
    code, output = run(*(ROOT / folder for folder in ("trees", "skills", "tasks")))
    assert (code, output) == (0, "")


def test_each_problem_has_its_line_marked(tmp_path: Path) -> None:
    """The message begins with the place; the line follows, with marks under what is meant."""
    path = tmp_path / "a.yaml"
    path.write_text("tree: t\nroot:\n  navigate: cup\n  rom: kitchen\n")
    assert run(path) == (
        1,
        f"{path}:4:3: unknown key 'rom'. Did you mean 'room'? Known: elsewhere, room, target. [unknown-key]\n"
        "    4 |   rom: kitchen\n"
        "      |   ^^^\n",
    )


def test_problems_of_all_files_come_at_once(tmp_path: Path) -> None:
    """Each file's problems are listed, and what cannot be read is one of them."""
    (tmp_path / "a.yaml").write_text("tree: t\nroot:\n  navigat: x\n")
    (tmp_path / "b.json").write_text('{"task_name": "t", "segments": []}')
    (tmp_path / "c.yaml").write_text("hello: 1\n")
    files = [tmp_path / name for name in ("a.yaml", "b.json", "c.yaml", "d.yaml")]
    code, output = run(*files)
    shown = [line.removeprefix(str(tmp_path)).split(": ")[0] for line in output.splitlines() if line[0] == "/"]
    assert (code, shown) == (2, ["/a.yaml:3:3", "/b.json:1:32", "/c.yaml:1:1", "/d.yaml"])
    assert [p["code"] for p in json.loads(run(*files, "--json")[1])["problems"]] == [
        *("unknown-node", "wrong-length", "unknown-file", "unreadable")
    ]


def test_a_folder_stands_for_the_files_below_it(tmp_path: Path) -> None:
    """YAML and JSON at any depth, in order; hidden folders, other files and pipes are left alone."""
    for name in ("b/c/x.yaml", "a/y.yml", ".git/z.yaml", "a/readme.md"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("tree: [\n")
    os.mkfifo(tmp_path / "a" / "pipe.yaml")
    code, output = run(tmp_path, "--json")
    found = json.loads(output)
    assert (code, found["files"]) == (1, 2)
    assert [p["file"] for p in found["problems"]] == [str(tmp_path / "a/y.yml"), str(tmp_path / "b/c/x.yaml")]


def test_a_program_gets_what_it_needs_for_mending(tmp_path: Path) -> None:
    """The pointer leads to the value, the source is its line, and the names that would do are there."""
    path = tmp_path / "t.yaml"
    path.write_text(GOOD.replace("room: kitchen", "segments: [a/b]").replace("navigate:", "navigat:"))
    found = json.loads(run(path, "--json")[1])
    (problem,) = found["problems"]
    lines = path.read_text().splitlines()
    assert problem == {
        "file": str(path),
        "line": 14,
        "column": 11,
        "code": "unknown-node",
        "message": problem["message"],
        "severity": "error",
        "nearest": "navigate",
        "known": problem["known"],
        "pointer": "/root/children/0/child/child/navigat",
        "source": lines[13],
    }
    assert "navigate" in problem["known"]


def test_pointers_lead_to_the_value(tmp_path: Path) -> None:
    """A JSON pointer, its escapes undone, walks through the data to what is wrong."""
    path = tmp_path / "t.yaml"
    path.write_text(GOOD.replace("default: cup}", "default: cup, a/b~c: 1}"))
    (problem,) = json.loads(run(path, "--json")[1])["problems"]
    value: Any = load_marked(path)[0]
    for part in problem["pointer"].split("/")[1:]:
        part = part.replace("~1", "/").replace("~0", "~")
        value = value[int(part) if isinstance(value, list) else part]
    assert value == 1


@pytest.mark.parametrize(
    ("line", "column", "marked"),
    [
        ("  room: kitchen", 3, "room"),
        ("  room: the big kitchen  # with a table", 9, "the big kitchen"),
        ("  a: {b: 1, room: x}", 13, "room"),
        ("  - [1, two, 3]", 9, "two"),
        ('  "target": "a, b: c",', 13, '"a, b: c"'),
        ("  x: [1, 2]", 6, "["),
        ("  at: 12:30", 7, "12:30"),
        ("  x: 'it''s'", 6, "'it''s'"),
        ("ab", 3, ""),
    ],
)
def test_marks_lie_under_what_is_meant(line: str, column: int, marked: str) -> None:
    """A key, a value with its words, a quoted text, a bracket: the marks are as wide, and below it."""
    shown, marks = excerpt(line, 7, column)
    start = marks.index("^")
    assert shown[start : start + marks.count("^")] == marked
    assert shown == f"    7 | {line}"


@given(st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\n\r"), max_size=300), st.integers(-1, 400))
def test_no_line_is_too_wide_or_too_strange_to_show(line: str, column: int) -> None:
    """What is shown fits the screen, is printable, and has its marks within it."""
    shown, marks = excerpt(line, 123, column)
    assert columns(shown) <= WIDTH
    assert len(marks) <= WIDTH + 1
    assert (shown + marks).isprintable()
    assert "^" in marks


def test_wide_characters_do_not_move_the_marks() -> None:
    """Below a name in Chinese the marks stand where it does, and are as wide."""
    shown, marks = excerpt("  厨房: 桌子", 1, 7)
    assert columns(shown[: shown.index("桌")]) == marks.index("^")
    assert marks.count("^") == 4


@pytest.mark.parametrize(
    ("content", "code"),
    [
        (b"", "empty"),
        (b"\n\n# nothing\n", "empty"),
        (bytes(range(256)) * 20, "encoding"),
        (b"\x7fELF\x02\x01\x01" + b"\x00" * 500, "syntax"),
        (b"tree: a\x00b\n", "syntax"),
        ("tree: t\nroot: {say: hi}\n".encode("utf-16"), "encoding"),
        (b"tree: caf\xe9\n", "encoding"),
        (b"tree: t\nroot: &a\n  attempt:\n  child: *a\n", "alias"),
        (b"tree: t\nroot:\n  retry: " + b"9" * 5000 + b"\n  child: {succeed: x}\n", "wrong-type"),
        (b"tree: t\nroot:\n  retry: 0x10\n  child: {succeed: x}\n", "wrong-type"),
        (b"[" * 5000, "too-deep"),
        (b"- " * 5000, "too-deep"),
        (b"{a: " * 5000, "too-deep"),
        (b"? " * 5000, "syntax"),
        (b"null\n", "unknown-file"),
        (b"--- 1\n--- 2\n", "syntax"),
        (b"\t\n", "syntax"),
        (b"%YAML 9.9\n---\na\n", "syntax"),
        (b"tree: \"\\ud800\"\n", "syntax"),
    ],
)  # fmt: skip
def test_no_content_brings_it_down(tmp_path: Path, content: bytes, code: str) -> None:
    """Whatever is in a file, it is one problem or more with a code, and is shown."""
    path = tmp_path / "t.yaml"
    path.write_bytes(content)
    problems = problems_in(str(path))
    assert code in [p.code for p in problems], problems
    returned, output = run(path)
    assert returned == 1
    assert all(len(line) <= 500 for line in output.splitlines())


@given(st.binary(max_size=200))
def test_no_bytes_bring_it_down(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    """Any bytes are a list of problems."""
    for name in ("t.yaml", "t.json"):
        path = tmp_path_factory.mktemp("bytes") / name
        path.write_bytes(content)
        assert problems_in(str(path))


@pytest.mark.parametrize("name", ["none.yaml", "folder", "a\0b", "x" * 5000])
def test_what_is_no_file_is_a_problem(tmp_path: Path, name: str) -> None:
    """No file, an empty folder, an impossible name: one line each."""
    (tmp_path / "folder").mkdir()
    assert [p.code for p in problems_in(str(tmp_path / name))] == ["unreadable"]


@pytest.mark.parametrize("change", [lambda t: t.replace("\n", "\r\n"), lambda t: "\ufeff" + t, lambda t: t.rstrip()])
def test_line_ends_and_byte_order_marks_do_not_matter(tmp_path: Path, change: Any) -> None:
    """A good tree stays good, and a bad line keeps its number."""
    path = tmp_path / "t.yaml"
    path.write_bytes(change(GOOD).encode())
    assert problems_in(str(path)) == []
    path.write_bytes(change(GOOD.replace("at_least", "at_leest")).encode())
    assert [(p.line, p.column) for p in problems_in(str(path))] == [(27, 7)]


def test_a_pipe_is_read_once() -> None:
    """What another command writes can be checked, and is not waited for again when it is shown."""
    code = "from mpvi_bt.apps.cli import main; main()"
    command = f'"{sys.executable}" -c "{code}" check <(printf "tree: t\\nroot: [")'
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=30, check=False)
    assert (done.returncode, done.stdout.count("[syntax]")) == (1, 1)


@pytest.mark.parametrize(
    "words", [["check", "TREE"], ["fmt", "--check", "TREE"], ["schema"], ["list", "nodes"], ["list", "trees"]]
)
def test_what_reads_trees_loads_no_numpy_and_no_simulator(words: list[str]) -> None:
    """Nor py_trees: that a tree is fine is known without them."""
    heavy = ("numpy", "py_trees", "sapien", "torch", "scipy", "numba")
    args = [str(ROOT / "trees" / "fetch.yaml") if word == "TREE" else word for word in words]
    code = (
        "import sys\nfrom mpvi_bt.apps.cli import main\n"
        f"try: main({args!r})\nfinally: print([m for m in {heavy} if m in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.splitlines()[-1] == "[]"


def test_a_file_that_is_wrong_all_over_gives_a_list_that_can_be_read(tmp_path: Path) -> None:
    """The first problems of each file, and a word that there may be more."""
    path = tmp_path / "t.yaml"
    nodes = "".join(f"    - navigate: x\n      rom{i}: x\n" for i in range(9000))
    path.write_text(f"tree: x\nroot:\n  sequence:\n  memory: true\n  children:\n{nodes}")
    done = CliRunner().invoke(check, [str(path)], standalone_mode=False)
    assert done.stdout.count("[unknown-key]") == MAX_PROBLEMS
    assert f"only the first {MAX_PROBLEMS} problems" in done.stderr


def long_tree() -> str:
    """2,000 lines: what a plan of 220 segments, with counters, compiles to."""
    lines = ["tree: long", "blackboard:", "  cups: 0", "root:", "  sequence: long", "  memory: true", "  children:"]
    while len(lines) < 2000:
        lines += f"""\
    - attempt: {len(lines)} go to the cup
      child:
        timeout: 120
        child:
          navigate: cup
          room: kitchen
    - attempt: {len(lines)} pick up the cup
      child:
        timeout: 90
        child:
          until_complete:
          children:
            - manipulate: pick up the cup with the left hand
            - check_complete: the cup is held in a gripper
              skill: pick
    - set: cups
      add: 1
    - test: cups
      at_least: {len(lines)}""".splitlines()
    return "\n".join(lines) + "\n"


def test_a_long_tree_is_checked_in_no_time(tmp_path: Path) -> None:
    """2,000 lines take well under a second of this process (0.25 s here), whatever else the machine does."""
    path = tmp_path / "long.yaml"
    path.write_text(long_tree())
    assert problems_in(str(path)) == []
    began = time.process_time()
    problems_in(str(path))
    assert time.process_time() - began < 0.5


def _bomb() -> str:
    return "".join(f"k{i}: &k{i} [{', '.join([f'*k{i - 1}'] * 9) if i else '1'}]\n" for i in range(12))


HUGE = {
    "million nodes": lambda: (
        "tree: x\nroot:\n  sequence:\n  memory: true\n  children:\n" + "    - look_around:\n" * 10**6
    ),
    "million values": lambda: "[" + "1," * 10**6 + "1]",
    "million keys": lambda: "".join(f"k{i}: x\n" for i in range(10**6)),
    "many bad nodes": lambda: (
        "tree: x\nroot:\n  sequence:\n  memory: true\n  children:\n"
        + "".join(f"    - navigat{i}: x\n" for i in range(19_000))
    ),
    "many unwritten keys, deep down": lambda: (
        "tree: x\nroot:\n"
        + "".join(f"{' ' * i}  attempt:\n{' ' * i}  child:\n" for i in range(80))
        + "".join(
            f"{' ' * 80}  {line}\n" for line in ("sequence:", "memory: true", "children:", *["- say: $k"] * 12_000)
        )
    ),
    "thousand deep": lambda: "".join(" " * i + "a:\n" for i in range(1000)),
    "thousand deep, flow": lambda: "[" * 1000 + "]" * 1000,
    "million deep": lambda: "[" * 10**6,
    "alias bomb": _bomb,
    "anchors in anchors": lambda: "".join(f"&a{i} [" for i in range(190)) + "1," * 39_000 + "]" * 190,
    "one line": lambda: "tree: " + "x" * 8 * 2**20,
    "one line, within the limit": lambda: "tree: " + "x" * (2**21 - 10),
    "same key": lambda: "a: 1\n" * 10**5,
    "open quote": lambda: 'tree: "' + "x" * (2**21 - 10),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", [*HUGE, "100 MB"])
def test_what_would_eat_the_machine_is_refused_in_time(tmp_path: Path, name: str) -> None:
    """In a process of its own: within 3 s of CPU and 500 MB, both set as limits of the system, and with exit code 1.

    The slowest takes 1.9 s where nothing else runs, and more beside another test on the same core.
    """
    path = tmp_path / "huge.yaml"
    if name in HUGE:
        path.write_text(HUGE[name]())
    else:
        with path.open("wb") as file:
            file.write(b"- navigate: cup\n" * (100 * 2**20 // 16))

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (3, 3))
        resource.setrlimit(resource.RLIMIT_AS, (500 * 2**20, 500 * 2**20))

    command = [sys.executable, "-c", "from mpvi_bt.apps.cli import main; main()", "check", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, preexec_fn=limit, check=False, timeout=60)
    assert done.returncode == 1, done.stderr[-500:]
    assert len(done.stdout) < 200_000
