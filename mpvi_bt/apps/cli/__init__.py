"""The `mpvi` command: its table of commands, its help, and the way in.

The table is static and the help needs no library, so that `mpvi --help` costs hardly more than starting Python.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Sequence

INTERRUPTED = 130  # 128 + SIGINT, as shells count
NOBODY_READS = 141  # 128 + SIGPIPE: what read our output, such as `head`, went away

# name: (module:function, one line of help)
COMMANDS: dict[str, tuple[str, str]] = {
    "run": ("mpvi_bt.apps.cli.run:run", "Run one episode with the tree shown live, then its score."),
    "plan": ("mpvi_bt.apps.cli.plan:plan", "Write the plan of a task, or of an instruction, as JSON."),
    "compile": ("mpvi_bt.apps.cli.compile_plan:compile_", "Write the tree of a plan, as YAML."),
    "render": ("mpvi_bt.apps.cli.render:render", "Draw a tree, or where a run stands, as text, picture or page."),
    "new": ("mpvi_bt.apps.cli.new:new", "Write files to begin with: a task, tree, skill, object, policy."),
    "show": ("mpvi_bt.apps.cli.show:show", "Draw a thing of the catalogue, a task's house, or all families."),
    "check": ("mpvi_bt.apps.cli.check:check", "List every problem in YAML files, with line and column."),
    "edit": ("mpvi_bt.apps.cli.edit:edit", "Edit a tree in a browser, with its problems and a dry run."),
    "fmt": ("mpvi_bt.apps.cli.fmt:fmt", "Bring trees into canonical form, with their comments."),
    "schema": ("mpvi_bt.apps.cli.editor_schema:schema", "Print what editors need to complete and check trees."),
    "convert": ("mpvi_bt.apps.cli.convert:convert", "Turn a tree into BehaviorTree.CPP 4 XML, or back."),
    "watch": ("mpvi_bt.apps.cli.watch:watch", "Serve a page that shows a run or a suite while it goes on."),
    "replay": ("mpvi_bt.apps.cli.replay:replay", "Show a recorded run, tick by tick, forward and back."),
    "explain": ("mpvi_bt.apps.cli.trace:explain_", "Say why a recorded run ended as it did."),
    "diff": ("mpvi_bt.apps.cli.trace:diff_", "Show the first tick at which two recorded runs part."),
    "suite": ("mpvi_bt.apps.cli.suite:suite", "Run many episodes, resume them, tabulate the scores."),
    "calibrate": ("mpvi_bt.apps.cli.calibrate:calibrate", "Set the thresholds of monitors by runs that went well."),
    "dataset": ("mpvi_bt.apps.cli.dataset:dataset", "Make a LeRobot dataset of recorded demonstrations."),
    "train": ("mpvi_bt.apps.cli.train:train", "Train the weights of the learned policy."),
    "serve": ("mpvi_bt.apps.cli.serve:serve", "Serve a policy, or the executive, to other programs."),
    "ros2": ("mpvi_bt.apps.cli.ros2:ros2", "Drive a robot over ROS 2, or be one: our house."),
    "mcp": ("mpvi_bt.apps.cli.mcp:mcp", "Let agents plan, check, run and explain trees, over MCP."),
    "evaluate": (
        "mpvi_bt.apps.cli.evaluate_server:evaluate",
        "Drive a server as BEHAVIOR's evaluator would, in our house.",
    ),
    "list": ("mpvi_bt.apps.cli.listing:list_", "List tasks, skills, trees, objects, families, backends."),
    "doctor": ("mpvi_bt.apps.cli.doctor:doctor", "Check this machine, and print a command for each problem."),
}

_HELP = """\
Usage: mpvi COMMAND [ARGS]...

  Long-horizon mobile manipulation with behavior trees.

Commands:
{commands}

Options:
  --version   Show the version.
  -h, --help  Show this, or the help of a command.

Examples:
  mpvi list tasks
  mpvi run picking_up_trash
  mpvi run --help

Exit codes: 0 done, 1 the task or check failed, 2 bad usage or input,
3 a fault of a backend or the machine, 130 interrupted, 141 broken pipe.
"""


def help_text() -> str:
    """What `mpvi --help` prints."""
    return _HELP.format(commands="\n".join(f"  {name:9} {line}" for name, (_, line) in COMMANDS.items()))


def main(args: Sequence[str] | None = None) -> None:
    """Run the command line and exit with its code.

    Args:
        args: The words after `mpvi`; those of this process by default.
    """
    words = list(sys.argv[1:] if args is None else args)
    if words in ([], ["-h"], ["--help"]) and "_MPVI_COMPLETE" not in os.environ:  # tab completion passes no words
        with contextlib.suppress(OSError):  # nobody takes it: told below
            print(help_text(), end="", flush=True)
            sys.exit(0 if words else 2)
    try:
        from mpvi_bt.ground.standard_streams import keep_stdout

        keep_stdout()
        from mpvi_bt.apps.cli.group import run

        sys.exit(run(words))
    except KeyboardInterrupt:  # while click was loading
        print("mpvi: interrupted", file=sys.stderr)
        sys.exit(INTERRUPTED)
