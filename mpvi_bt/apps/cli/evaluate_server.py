"""`mpvi evaluate`: a stand-in for BEHAVIOR's evaluator, which drives a server in our house."""

from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING, Any

import click

from mpvi_bt.apps.cli.argument_types import Name, check_writable, out_folder
from mpvi_bt.apps.cli.status import Status
from mpvi_bt.apps.cli.work_options import assisted, robot_option, seconds, tell_goal
from mpvi_bt.executive.drawing.terminal import tell
from mpvi_bt.ground.robot.protocol import CONTROL_HZ

if TYPE_CHECKING:
    from mpvi_bt.ground.geometry.solids import Array

EVERY_S = 0.5  # the status line is drawn anew


@click.command()
@click.argument("task", type=Name("tasks"))
@click.argument("address", default="localhost:8000")
@click.option(
    "--dialect",
    type=click.Choice(["behavior-2025", "behavior-2026", "openpi"]),
    required=True,
    help="Protocol of the server.",
)
@click.option(
    "--instance",
    "instances",
    type=click.IntRange(min=0),
    multiple=True,
    help="Start state; may be repeated.  [default: 0]",
)
@robot_option("Robot in the house, or its file.", "r1pro")
@click.option(
    "--batched/--unbatched",
    default=None,
    help="Whether arrays have a leading 1, as since 3.9.3 of 2026.  [default: by the dialect]",
)
@click.option("--chunk", type=click.IntRange(1, 1024), metavar="K", help="Ask for K actions at once; not in 2025.")
@click.option("--labels", is_flag=True, help="Send labels of pictures; no real evaluator does.")
@click.option("--on-demand", is_flag=True, help="Send only pictures that the server asks for; evaluators send all.")
@assisted
@click.option(
    "--max-steps",
    type=click.IntRange(min=1),
    metavar="N",
    help="Time limit of an episode.  [default: by human demonstrations]",
)
@seconds("--wait", 60.0, "Longest wait for the server to start.")
@out_folder("runs/evaluated", "Folder of the results, in the evaluator's layout.")
@click.option("--json", "as_json", is_flag=True, help="Print the results as JSON.")
def evaluate(dialect: Any, instances: tuple[int, ...], batched: bool | None, as_json: bool, **given: Any) -> int:
    """Drive a server through TASK as BEHAVIOR's evaluator does, in our house instead of its scenes.

    ADDRESS is localhost:8000 by default. This tries the protocol and the whole way from pictures to actions where there
    is no GPU; scores are of our house. docs/evaluator.md says what differs.

    Exit code 0 where the goal is true at the end of every instance, 1 where it is not, 3 where the server fails.
    """
    from mpvi_bt.runs.serving.evaluator import Evaluation
    from mpvi_bt.runs.serving.evaluator import evaluate as evaluate_

    check_writable(given["out"])
    if batched is None:
        batched = dialect == "behavior-2026"
    progress = EvaluationStatus()
    session = Evaluation(dialect=dialect, instances=instances or (0,), batched=batched, **given)
    try:
        rollouts = evaluate_(session, progress)
    finally:
        progress.clear()
    if as_json:
        tell(json.dumps([{"ended": rollout.ended, **rollout.result} for rollout in rollouts], indent=2))
    else:
        for rollout in rollouts:
            tell_goal(rollout.task, rollout.instance, rollout.goal, rollout.ended)
    return 0 if all(rollout.goal.satisfied for rollout in rollouts) else 1


class EvaluationStatus(Status):
    """How an evaluation goes."""

    def __init__(self) -> None:
        super().__init__()
        self._next_s, self._since = 0.0, (0, 0.0)

    def said(self, line: str) -> None:
        """What a person should know."""
        self.say(line)

    def stepped(self, instance: int, step: int, most: int) -> None:
        """A control step was carried out."""
        now = time.monotonic()
        if now < self._next_s:
            return
        before, when = self._since
        rate = f", {(step - before) / (now - when):.0f} steps/s" if step > before else ""
        self.draw(f"instance {instance}: step {step} of at most {most}, {step / CONTROL_HZ:.0f} s{rate}")
        self._next_s, self._since = now + EVERY_S, (step, now)

    def acted(self, instance: int, action: Array) -> None:
        """Nothing."""
