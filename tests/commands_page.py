"""The page of all commands and options: `python -m tests.commands_page` writes docs/commands.md."""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from mpvi_bt.apps.cli import COMMANDS

FILE = Path(__file__).parent.parent / "docs" / "commands.md"
HEAD = """\
# Commands

Every command with its options, as `mpvi COMMAND --help` prints them. `python -m tests.commands_page` writes this page.
"""


def text() -> str:
    """The page as it is to be."""
    sections = [HEAD]
    for name, (where, _) in COMMANDS.items():
        module, _, attribute = where.partition(":")
        command = getattr(importlib.import_module(module), attribute)
        sections += _sections(command, click.Context(click.Group("mpvi"), info_name="mpvi"), name, "##")
    return "\n".join(sections)


def _sections(command: Any, above: click.Context, name: str, level: str) -> Iterator[str]:
    """A command's section, and those of its subcommands."""
    context = click.Context(command, parent=above, info_name=name)
    usage = " ".join([context.command_path, *command.collect_usage_pieces(context)])
    about = "\n\n".join(_paragraphs(inspect.cleandoc(command.help or "")))
    lines = [f"{level} {context.command_path}", "", "```", usage, "```", "", about, ""]
    records = [record for p in command.get_params(context) if (record := p.get_help_record(context)) is not None]
    records = [(names, said) for names, said in records if said and "--help" not in names]
    lines += [*(f"- `{names}`: {_prose(said)}" for names, said in records), *([""] if records else [])]
    yield "\n".join(lines)
    for inner in command.list_commands(context) if isinstance(command, click.Group) else ():
        yield from _sections(command.get_command(context, inner), context, inner, level + "#")


def _paragraphs(help_: str) -> Iterator[str]:
    """Paragraphs on one line each; those that begin with a backspace, which click leaves as they are, as code."""
    for paragraph in help_.split("\n\n"):
        if paragraph.startswith("\b"):
            yield "```\n" + paragraph.removeprefix("\b\n") + "\n```"
        else:
            yield _prose(" ".join(paragraph.split()))


def _prose(words: str) -> str:
    """Words outside of code, in which Markdown and HTML find nothing of theirs."""
    parts = re.split(r"(`[^`]*`)", " ".join(words.split()))
    parts[::2] = [re.sub(r"([*_<\[\]])", r"\\\1", part) for part in parts[::2]]
    return "".join(parts)


if __name__ == "__main__":
    FILE.write_text(text(), encoding="utf-8")
