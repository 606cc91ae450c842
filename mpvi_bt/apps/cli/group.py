"""The click group behind `mpvi`: each command's module loads only when it runs; every error has its exit code."""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import sys
import traceback
from collections.abc import Sequence
from typing import Any

import click

from mpvi_bt.apps.cli import COMMANDS, INTERRUPTED, NOBODY_READS, help_text
from mpvi_bt.apps.cli.examples import with_examples
from mpvi_bt.executive.drawing.terminal import guarded, results_alone, tell
from mpvi_bt.ground.errors import FileProblems, MpviError, NodeError, UnknownName, UserError
from mpvi_bt.ground.version import __version__
from mpvi_bt.ground.writing import unwritable


class _NobodyReads(Exception):
    """Whoever read our output, such as `head`, has had enough; click takes a BrokenPipeError for a failed task."""


class LazyGroup(click.Group):
    """A group whose commands are named in `COMMANDS` and imported when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order of the table: the most used first."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the command.

        Raises:
            UnknownName: There is none of that name.
        """
        if cmd_name not in COMMANDS:
            if ctx.resilient_parsing:  # tab completion asks for what is half typed
                return None
            raise UnknownName("command", cmd_name, COMMANDS)
        module, function = COMMANDS[cmd_name][0].split(":")
        command = getattr(importlib.import_module(module), function)
        assert isinstance(command, click.Command)
        return _keeping_results(with_examples(command, cmd_name))

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command. Its errors pass through; a broken pipe gets a name unknown to click."""
        try:
            return super().invoke(ctx)
        except BrokenPipeError as error:
            raise _NobodyReads from error

    def get_help(self, ctx: click.Context) -> str:
        """The same text that `mpvi --help` prints without click."""
        return help_text()


def _keeping_results(command: click.Command) -> click.Command:
    """The command, and those of a group: while one runs, the standard output is for results alone."""
    if command.callback is not None and not vars(command).get("keeps_results"):
        command.callback = results_alone()(command.callback)
        vars(command)["keeps_results"] = True
    for inner in getattr(command, "commands", {}).values():
        _keeping_results(inner)
    return command


@click.command(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="mpvi")
def cli() -> None:
    """Long-horizon mobile manipulation with behavior trees."""


def run(args: Sequence[str]) -> int:
    """Run one command and say how it ended; a command returns its exit code, or None for 0."""
    with guarded():
        code = _run(list(args))
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):  # Python would try again at exit, and end with a code of its own
            with contextlib.suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    return code


def _run(args: list[str]) -> int:
    try:
        result = cli.main(args, prog_name="mpvi", standalone_mode=False, obj=tuple(args))
        sys.stdout.flush()
    except click.exceptions.NoArgsIsHelpError as error:  # a group without a command: its help, as it is laid out
        _say(error.format_message())
        return UserError.exit_code
    except click.exceptions.Abort:  # what click makes of Ctrl-C
        _say("mpvi: interrupted")
        return INTERRUPTED
    except click.ClickException as error:
        return _failed(args, UserError(_usage(error)))
    except MpviError as error:
        return _failed(args, error)
    except (_NobodyReads, BrokenPipeError):
        return NOBODY_READS
    except OSError as error:
        _say(f"mpvi: {unwritable(error.filename or 'what is printed', error)}")
        return MpviError.exit_code
    except Exception:  # a fault of ours, which must not pass for exit code 1, "the task failed"
        _say(traceback.format_exc() + "mpvi: that is a fault in mpvi_bt; please report it with the lines above")
        return MpviError.exit_code
    return result if isinstance(result, int) else 0


def _failed(args: list[str], error: MpviError) -> int:
    """Tell an error: to people on stderr, to programs that asked for JSON on stdout too."""
    if isinstance(error, FileProblems):
        from mpvi_bt.apps.cli.problems import as_text

        _say("\n".join(as_text(error.problems)))
    else:
        _say(f"mpvi: {error}")
    if "--json" in args:
        told = {"exit_code": error.exit_code, "message": str(error)}
        if isinstance(error, NodeError):
            told |= {"node": error.path, "place": error.place}
        if isinstance(error, FileProblems):
            told |= {"problems": [vars(problem) for problem in error.problems]}
        with contextlib.suppress(OSError):
            tell(json.dumps({"error": told}, indent=2))
    return error.exit_code


def _say(text: str) -> None:
    with contextlib.suppress(OSError):  # stderr is full or closed too: the exit code says it
        click.echo(text, err=True)


def _usage(error: click.ClickException) -> str:
    """The error in the given words, and a hint at the help, in one line."""
    message = " ".join(error.format_message().split())
    context = error.ctx if isinstance(error, click.UsageError) else None
    message = message if message.endswith((".", "?", "!")) else f"{message}."
    return f"{message} See `{context.command_path} --help`." if context else message
