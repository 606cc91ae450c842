"""`mpvi compile`: the tree of a plan."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import click

from mpvi_bt.apps.cli.argument_types import File
from mpvi_bt.apps.cli.setting_options import settings
from mpvi_bt.executive.drawing.terminal import give, tell
from mpvi_bt.ground import paths
from mpvi_bt.ground.writing import write_whole

if TYPE_CHECKING:
    from mpvi_bt.executive.tree.compile import Drive


@click.command(name="compile")
@click.argument("plan", type=File("tasks/plans"))
@settings("on_failure", "drive")
@click.option("--out", type=click.Path(dir_okay=False), help="Write here instead of to the terminal.")
@click.option("--json", "as_json", is_flag=True, help='For programs: one JSON object with the text under "yaml".')
def compile_(plan: str, on_failure: str, drive: Drive, out: str | None, as_json: bool) -> None:
    """Write the tree of a plan, as YAML. PLAN is a file, or the name of a recorded plan or of a task."""
    from mpvi_bt.executive.plan.planners import RecordedPlanner
    from mpvi_bt.executive.plan.schema import load_plan
    from mpvi_bt.executive.plan.skills import load_skills
    from mpvi_bt.executive.tree.compile import compile_plan
    from mpvi_bt.executive.tree.yaml_io import dump_tree
    from mpvi_bt.runs.choices.planning import plan_of

    if plan.endswith(paths.SUFFIXES) or "/" in plan:
        loaded = load_plan(plan)
    elif plan not in paths.names("tasks/plans") and plan in paths.names("tasks"):
        loaded = plan_of(plan)
    else:
        loaded = RecordedPlanner().plan(plan)
    text = dump_tree(compile_plan(loaded, load_skills(), on_failure, drive))
    if out is not None:
        write_whole(out, text)
    if as_json:
        tell(json.dumps({"yaml": text, "out": out}))
    elif out is None:
        give(text)
