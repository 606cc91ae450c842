"""`mpvi plan`: the plan of a task or of an instruction; plans on file as data to fine-tune a planner on."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mpvi_bt.apps.cli.argument_types import File
from mpvi_bt.apps.cli.setting_options import settings
from mpvi_bt.executive.drawing.terminal import tell
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.writing import write_whole
from mpvi_bt.runs.choices.config import ASKING, EpisodeConfig

if TYPE_CHECKING:
    from mpvi_bt.executive.plan.planners import Planned

_FILE = click.Path(dir_okay=False, path_type=Path)


@click.command()
@click.argument("what", nargs=-1, type=File("tasks"), metavar='TASK | "INSTRUCTION"')
@settings("planner", *ASKING)
@click.option("--house", type=File("tasks/houses"), help="House that the planner knows.  [default: the task's]")
@click.option("--out", type=_FILE, metavar="FILE", help="Write here instead of to the terminal.")
@click.option(
    "--export", type=_FILE, metavar="FILE", help="Write the recorded plans as chats for fine-tuning, one JSON a line."
)
@click.option("--json", "as_json", is_flag=True, help="For programs: one JSON object with the plan and its cost.")
def plan(
    what: tuple[str, ...],
    planner: str,
    house: str | None,
    out: Path | None,
    export: Path | None,
    as_json: bool,
    **asking: Any,
) -> None:
    """Write the plan of a TASK, or of an INSTRUCTION in words, as JSON.

    One word is a task, by name or file; several are an instruction. Recorded plans are those of tasks; a language model
    plans anything. --export writes the recorded plans of the TASKs that are given, or all there are.
    """
    if export is not None:
        _export(what, export, as_json)
        return
    from mpvi_bt.executive.plan.prompt import told
    from mpvi_bt.runs.choices.language_models import Models, language_doubts
    from mpvi_bt.runs.choices.named_task import task_named
    from mpvi_bt.runs.choices.planning import make_planner, plan_findings

    given = " ".join(what).strip()
    if not given:
        raise click.UsageError("Missing argument: a TASK, or an INSTRUCTION in words.")
    task = None if any(c.isspace() for c in given) else task_named(given)
    if task is None and planner == EpisodeConfig.planner:
        raise UserError("plans are recorded of tasks only: name one, or choose a model, --planner openai:MODEL.")
    if house is not None and planner == EpisodeConfig.planner:
        raise click.UsageError("--house is told to a model; recorded plans are as they are.")
    stem = Path(given).stem if task else "instruction"
    beside = Path("runs") / f"{stem}.plan.json" if out is None else out
    config = EpisodeConfig(given if task else "", planner=planner, planned=beside, **asking)
    maker = make_planner(config, task, Models(config), house, lambda line: click.echo(f"mpvi: {line}", err=True))
    for doubt in language_doubts([config]):
        click.echo(f"mpvi: {doubt}", err=True)
    planned = maker.ask(task.plan or config.task_name, task.instruction) if task else maker.ask("", given)
    if not planned.answers:  # a model was told all of it
        planned = replace(planned, doubts=tuple(plan_findings(planned.plan, task=task)))
    text = planned.plan.to_json()
    if out is not None:
        write_whole(out, text)
    for line in told(planned.doubts):
        click.echo(f"mpvi: {line}", err=True)
    if as_json:
        tell(json.dumps(_all(planned, maker.name, out), indent=2))
    elif out is None:
        tell(text, nl=False)


def _all(planned: Planned, planner: str, out: Path | None) -> dict[str, Any]:
    """The plan, its post-processing, and the cost of planning."""
    from mpvi_bt.executive.plan.primitives import primitives
    from mpvi_bt.executive.plan.skills import load_skills
    from mpvi_bt.runs.episode.result import Planning

    found = primitives(planned.plan, load_skills())
    took = Planning.of(planned)
    return {
        "plan": planned.plan.model_dump(exclude_none=True),
        "planner": planner,
        "primitives": [
            {"segment": i, "skill": p.call.skill.name if p.call else None, "terminal": p.terminal}
            for i, p in found.items()
        ],
        "problems": [vars(problem) for problem in planned.doubts],
        "planning": took.model_dump() if took else None,
        "out": str(out) if out else None,
    }


def _export(tasks: Sequence[str], file: Path, as_json: bool) -> None:
    """Write the recorded plans of tasks as chats; of all plans on file if none is named."""
    from mpvi_bt.executive.plan.finetuning import chats
    from mpvi_bt.executive.plan.planners import RecordedPlanner
    from mpvi_bt.executive.plan.skills import load_skills
    from mpvi_bt.ground import paths
    from mpvi_bt.runs.choices.named_task import task_named
    from mpvi_bt.runs.choices.planning import ground

    known = {name: task_named(name) for name in tasks or paths.names("tasks")}
    places = {house: ground(house) for house in {task.house for task in known.values()}}
    grounds = {task.plan: places[task.house] for task in known.values()}
    planner = RecordedPlanner()
    plans = [planner.plan(task.plan or name) for name, task in known.items()] if tasks else planner.all()
    lines = list(chats([(plan, grounds.get(plan.task_name)) for plan in plans], load_skills()))
    write_whole(file, "".join(f"{line}\n" for line in lines))
    if as_json:
        tell(json.dumps({"out": str(file), "chats": len(lines)}))
    else:
        click.echo(f"mpvi: {len(lines)} chats", err=True)
