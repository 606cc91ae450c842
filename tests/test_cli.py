"""The command line: help, exit codes, errors in one line."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from mpvi_bt.apps.cli import COMMANDS, main
from mpvi_bt.apps.cli.group import LazyGroup, cli
from mpvi_bt.apps.cli.listing import FOLDERS
from mpvi_bt.ground import errors, paths
from tests.conftest import Shell


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_in_the_table_is_there(name: str) -> None:
    """Each line of the table leads to a click command of that name, with help of its own."""
    command = cli.get_command(click.Context(cli), name)
    assert command is not None
    assert command.name == name
    assert command.help


def test_help_fits_the_screen(mpvi: Shell) -> None:
    """`mpvi --help` names every command within 80 columns, and click's own help says the same."""
    done = mpvi("--help")
    assert all(f"  {name} " in done.stdout for name in COMMANDS)
    assert max(map(len, done.stdout.splitlines())) <= 80
    assert click.Context(cli).get_help() == done.stdout


def _commands(command: click.Command, words: str) -> Iterator[tuple[str, click.Command]]:
    """A command and those below it, by the words that call them."""
    yield words, command
    for name, inner in getattr(command, "commands", {}).items():
        yield from _commands(inner, f"{words} {name}")


@pytest.mark.parametrize("name", COMMANDS)
def test_every_help_ends_in_three_examples_that_are_understood(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each is a call of that very command whose names, options and values are known; the help fits the screen."""
    monkeypatch.chdir(tmp_path)
    for folder in ("demos", "more_demos", "data", "check", "runs/watched"):
        Path(folder).mkdir(parents=True)
    command = cli.get_command(click.Context(cli), name)
    assert command is not None
    for words, inner in _commands(command, name):
        text = inner.get_help(click.Context(inner, info_name=f"mpvi {words}", terminal_width=80))
        assert max(map(len, text.splitlines())) <= 80
        examples = re.findall(rf"^    mpvi {words}\b ?(.*)$", text.partition("Examples:")[2], re.MULTILINE)
        assert len(examples) == 3, words
        for example in examples:
            call, *_ = re.split(r" ?(?:>|\|\|) ", example)
            called = inner
            while isinstance(called, click.Group) and not called.invoke_without_command:
                word, _, call = call.partition(" ")
                called = called.commands[word]
            called.make_context(name, shlex.split(call))


@pytest.mark.parametrize("what", ["tasks", "suites", "methods", "skills", "trees"])
def test_a_list_has_a_line_for_each(what: str, capsys: pytest.CaptureFixture[str]) -> None:
    """However much a file says of itself; `--long` says it all."""
    with pytest.raises(SystemExit):
        main(["list", what])
    lines = capsys.readouterr().out.splitlines()
    names = paths.names(FOLDERS[what])
    assert [line.split()[0] for line in lines] == names
    assert max(map(len, lines)) <= 80
    with pytest.raises(SystemExit):
        main(["list", what, "--long"])
    long = capsys.readouterr().out
    assert "..." not in long
    assert ("..." in "".join(lines)) is (len(long.splitlines()) > len(lines))


@pytest.mark.parametrize(
    ("args", "code"),
    [
        (["--help"], 0),
        (["--version"], 0),
        (["rum"], 2),
        (["run"], 2),
        (["list", "nothing"], 2),
        (["list", "backends"], 0),
    ],
)
def test_exit_codes(args: list[str], code: int) -> None:
    """What was asked for ends with 0, bad usage with 2."""
    with pytest.raises(SystemExit) as exit_:
        main(args)
    assert exit_.value.code == code


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (errors.UserError("what was given"), 2),
        (errors.BackendError("what broke"), 3),
        (KeyboardInterrupt(), 130),
        (RuntimeError("a fault of ours"), 3),
    ],
)
def test_every_kind_of_error_has_its_exit_code(
    error: BaseException, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Errors end the command with their code; ours in one line, without a traceback."""

    def fail(*args: object, **kwargs: object) -> None:
        raise error

    monkeypatch.setattr(LazyGroup, "invoke", fail)
    with pytest.raises(SystemExit) as exit_:
        main(["list", "backends"])
    said = capsys.readouterr().err
    assert exit_.value.code == code
    if isinstance(error, errors.MpviError):
        assert said == f"mpvi: {error}\n"


@pytest.mark.parametrize("args", [["run"], ["list"], ["run", "picking_up_trash", "--instance", "-1"], ["check"]])
def test_bad_usage_is_told_in_one_line(args: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """What is wrong with the words given takes one line, which names the help to read."""
    with pytest.raises(SystemExit) as exit_:
        main(args)
    said = capsys.readouterr().err
    assert exit_.value.code == 2
    assert said.startswith("mpvi: ")
    assert said.endswith(f"See `mpvi {args[0]} --help`.\n")
    assert said.count("\n") == 1


@pytest.mark.parametrize("group", ["new", "suite", "train"])
def test_a_group_without_a_command_tells_its_help_as_it_is_laid_out(
    group: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """On standard error, in the lines of `--help`."""
    with pytest.raises(SystemExit) as help_:
        main([group, "--help"])
    told = capsys.readouterr().out
    with pytest.raises(SystemExit) as exit_:
        main([group])
    assert (help_.value.code, exit_.value.code) == (0, 2)
    assert capsys.readouterr().err.strip() == told.strip()


@pytest.mark.parametrize("option", ["--out", "--video", "--picture", "--rerun", "--mcap", "--profile"])
def test_what_cannot_be_written_is_refused_before_the_run(
    option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A folder that cannot be made ends `mpvi run` at once, with one line, not after a minute's work."""
    (tmp_path / "file").touch()
    with pytest.raises(SystemExit) as exit_:
        main(["run", "picking_up_trash", option, str(tmp_path / "file" / "below" / "name")])
    said = capsys.readouterr().err
    assert exit_.value.code == 2
    assert said.count("\n") == 1
    assert "not a directory" in said


def test_a_list_says_which_of_its_files_are_broken(mpvi: Shell, tmp_path: Path) -> None:
    """One that lacks keys reads well and yet cannot be used."""
    (tmp_path / "skills").mkdir()
    (tmp_path / "skills" / "wave.yaml").write_text("name: wave\nabout: Wave a hand.\n")
    done = mpvi("list", "skills", MPVI_PATH=str(tmp_path))
    assert "(broken; see `mpvi check" in done.stdout
    assert "Wave a hand." not in done.stdout
    assert done.stdout.count("broken") == 1


def test_unknown_command_names_the_nearest(mpvi: Shell) -> None:
    """A typing error is answered with the command that was meant."""
    done = mpvi("docter")
    assert (done.returncode, done.stdout) == (2, "")
    assert "Did you mean 'doctor'?" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_output_that_nobody_reads_is_no_fault(tmp_path: Path) -> None:
    """`mpvi list ... | head -0` ends quietly."""
    code = "from mpvi_bt.apps.cli import main; main(['list', 'backends'])"
    done = subprocess.run(
        ["/bin/sh", "-c", f'"{sys.executable}" -c "{code}" | head -c 0'], capture_output=True, text=True, check=True
    )
    assert done.stderr == ""


@pytest.mark.parametrize("words", ["list trees", "check .", "run --dry --tree hello", "render hello", "run --help"])
def test_a_full_disk_is_one_line(words: str, tmp_path: Path) -> None:
    """Where nothing can be printed any more the command says so, and ends as for a fault of the machine."""
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-c", "from mpvi_bt.apps.cli import main; main()", *words.split()],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            cwd=tmp_path,
        )
    assert done.returncode == 3
    assert done.stderr.splitlines()[-1] == "mpvi: what is printed: cannot be written: no space left on device"
    assert "Traceback" not in done.stderr


def test_a_reader_that_has_had_enough_is_no_failed_task(tmp_path: Path) -> None:
    """`mpvi run | head` goes on to its end, trace and all, and does not end with 1."""
    code = "from mpvi_bt.apps.cli import main; main(['run', '--dry', '--tree', 'evening_round'])"
    done = subprocess.run(
        ["/bin/bash", "-c", f'"{sys.executable}" -c "{code}" | head -1 >/dev/null; echo "${{PIPESTATUS[0]}}"'],
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
    )
    assert (done.stdout, done.stderr) == ("141\n", "")
    assert '{"end": "success"' in (tmp_path / "runs" / "evening_round_dry.trace.jsonl").read_text()


def test_errors_are_json_too(mpvi: Shell, tmp_path: Path) -> None:
    """With --json a program finds what went wrong on stdout, a person on stderr; the exit code is the same."""
    (tmp_path / "bad.yaml").write_text("tree: t\nroot:\n  wiat: 1\n")
    for words in ("run --dry --tree nope", "render bad.yaml", "explain none", "suite run"):
        done = mpvi(*words.split(), "--json")
        told = json.loads(done.stdout)["error"]
        assert (done.returncode, told["exit_code"]) == (2, 2)
        assert told["message"].splitlines()[0] in done.stderr
        assert ("problems" in told) == (words == "render bad.yaml")


def test_help_takes_at_most_five_times_a_bare_python() -> None:
    """Best of seven each, interleaved, in one run."""

    def seconds(*args: str) -> float:
        started = time.perf_counter()
        subprocess.run([sys.executable, *args], check=True, stdout=subprocess.DEVNULL)
        return time.perf_counter() - started

    pairs = [
        (seconds("-c", "pass"), seconds("-c", "from mpvi_bt.apps.cli import main; main(['--help'])")) for _ in range(7)
    ]
    bare, help_ = (min(column) for column in zip(*pairs, strict=True))
    assert help_ <= 5 * bare, f"--help took {help_ / bare:.1f} times as long"


def test_completion_knows_the_commands(mpvi: Shell) -> None:
    """Tab completion of bash offers the commands."""
    done = mpvi(_MPVI_COMPLETE="bash_complete", COMP_WORDS="mpvi do", COMP_CWORD="1")
    assert done.stdout.split() == ["plain,doctor"]
