"""The `mpvi` command. Each subcommand's module loads only when that subcommand runs."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence

import click

from mpvi_bt import __version__
from mpvi_bt.errors import MpviError

# name: (module:function, one line of help); static, so that --help and completion import nothing more
COMMANDS: dict[str, tuple[str, str]] = {
    "run": ("mpvi_bt.cli.run:run", "Run one episode with the tree shown live, then its score."),
    "compile": ("mpvi_bt.cli.trees:compile_", "The tree of a plan, as YAML."),
    "render": ("mpvi_bt.cli.trees:render", "Draw a tree."),
    "check": ("mpvi_bt.cli.trees:check", "Every problem in YAML files, each as file:line:col."),
    "suite": ("mpvi_bt.cli.suite:suite", "Run many episodes, resume them, and tabulate the scores."),
    "list": ("mpvi_bt.cli.listing:list_", "What tasks, skills, trees and backends there are."),
    "doctor": ("mpvi_bt.cli.doctor:doctor", "What this machine can do, and the command that mends what it cannot."),
}

INTERRUPTED = 130  # 128 + SIGINT, as shells count


class LazyGroup(click.Group):
    """A group whose commands are named in `COMMANDS` and imported when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order of the table: the most used first."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the command; None if there is none of that name (click then names the nearest)."""
        if cmd_name not in COMMANDS:
            return None
        module, function = COMMANDS[cmd_name][0].split(":")
        command = getattr(importlib.import_module(module), function)
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the table of commands from their one-line help, importing none of them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, line) for name, (_, line) in COMMANDS.items()])


@click.command(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="mpvi")
def cli() -> None:
    """Long-horizon mobile manipulation with behavior trees.

    Exit codes: 0 done, 1 the task or check failed, 2 bad usage or input, 3 a fault of a backend or the machine,
    130 interrupted.
    """


def main(args: Sequence[str] | None = None) -> None:
    """Run the command line and exit with its code; a command returns its code, or None for 0."""
    try:
        result = cli.main(None if args is None else list(args), prog_name="mpvi", standalone_mode=False)
        code = result if isinstance(result, int) else 0
    except click.exceptions.Abort:  # what click makes of Ctrl-C
        click.echo("mpvi: interrupted", err=True)
        code = INTERRUPTED
    except click.ClickException as error:
        error.show()
        code = 2
    except MpviError as error:
        click.echo(f"mpvi: {error}", err=True)
        code = error.exit_code
    except BrokenPipeError:  # the reader of our output, such as `head`, has had enough
        code = 0
    sys.exit(code)
