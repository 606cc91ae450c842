"""The click group behind `mpvi`: each command's module loads only when it runs; every error has its exit code."""

from __future__ import annotations

import importlib
import traceback
from collections.abc import Sequence

import click

from mpvi_bt import __version__
from mpvi_bt.cli import COMMANDS, INTERRUPTED, help_text
from mpvi_bt.errors import FileProblems, MpviError, UnknownName


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
        return command

    def get_help(self, ctx: click.Context) -> str:
        """The same text that `mpvi --help` prints without click."""
        return help_text()


@click.command(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="mpvi")
def cli() -> None:
    """Long-horizon mobile manipulation with behavior trees."""


def run(args: Sequence[str]) -> int:
    """Run one command and say how it ended; a command returns its exit code, or None for 0."""
    try:
        result = cli.main(list(args), prog_name="mpvi", standalone_mode=False)
    except click.exceptions.Abort:  # what click makes of Ctrl-C
        click.echo("mpvi: interrupted", err=True)
        return INTERRUPTED
    except click.ClickException as error:
        click.echo(f"mpvi: {_usage(error)}", err=True)
        return 2
    except FileProblems as error:
        from mpvi_bt.cli.problems import as_text

        for line in as_text(error.problems):
            click.echo(line, err=True)
        return error.exit_code
    except MpviError as error:
        click.echo(f"mpvi: {error}", err=True)
        return error.exit_code
    except BrokenPipeError:  # the reader of our output, such as `head`, has had enough
        return 0
    except Exception:  # a fault of ours, which must not pass for exit code 1, "the task failed"
        traceback.print_exc()
        click.echo("mpvi: that is a fault in mpvi_bt; please report it with the lines above", err=True)
        return MpviError.exit_code
    return result if isinstance(result, int) else 0


def _usage(error: click.ClickException) -> str:
    """What was wrong with the words given, and where to read on, in one line."""
    message = " ".join(error.format_message().split())
    context = error.ctx if isinstance(error, click.UsageError) else None
    return f"{message} See `{context.command_path} --help`." if context else message
