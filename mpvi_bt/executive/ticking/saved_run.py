"""A run that was stopped between two ticks, as JSON values, and going on from there."""

from __future__ import annotations

from typing import Annotated

from pydantic import ConfigDict, Field, JsonValue

from mpvi_bt.executive.behaviors.context import Context, Failure, Notice, Query, Replan, WatchedHandoff
from mpvi_bt.executive.behaviors.parameters import Value
from mpvi_bt.executive.monitors.handoff import INTERRUPTED, Handoff
from mpvi_bt.executive.ticking.loop import World
from mpvi_bt.executive.tree import saving
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.marked_yaml import Record


class SavedWorld(Record):
    """A world's saved state: its number of control steps, and its own data."""

    model_config = ConfigDict(extra="allow")

    steps: Annotated[int, Field(ge=0, le=saving.MAX_STEPS)]


class SavedRun(Record):
    """How a run stands.

    Attributes:
        tree: Statuses, the cursor of every sequence, and what each node declares.
        blackboard: Of the run.
        failures: Segments that were given up so far.
        queries: Questions to the checker so far.
        notices, replans, handoffs, diagnosis, clipped: As of the log so far; a handoff under way ends here.
        world: What the world says of itself.
        memory: What was learned.
        policy, checker: What these have counted, so that a late or faulty one draws on from there.
    """

    tree: saving.SavedTree
    blackboard: dict[str, Value] = {}
    failures: list[Failure] = []
    queries: list[Query] = []
    notices: list[Notice] = []
    replans: list[Replan] = []
    handoffs: list[WatchedHandoff] = []
    diagnosis: list[Handoff] = []
    clipped: Annotated[int, Field(ge=0)] = 0
    world: SavedWorld
    memory: dict[str, JsonValue] = {}
    policy: dict[str, JsonValue] = {}
    checker: dict[str, JsonValue] = {}


def save_run(tree: Tree, world: World) -> SavedRun:
    """How a run stands between two ticks."""
    context, log = tree.context, tree.context.log
    return SavedRun(
        tree=saving.save(tree),
        blackboard=dict(context.blackboard),
        failures=list(log.failures),
        queries=list(log.queries),
        notices=list(log.notices),
        replans=list(log.replans),
        handoffs=list(log.handoffs),
        diagnosis=[*log.diagnosis, *(watch.figures(world.time_s, INTERRUPTED) for watch in log.under_way)],
        clipped=log.clipped,
        world=SavedWorld.model_validate(world.save()),
        memory=context.memory.save() if context.memory else {},
        policy=getattr(context.policy, "save", dict)(),
        checker=getattr(context.checker, "save", dict)(),
    )


def restore_world(saved: SavedRun, world: World, context: Context) -> None:
    """Bring a fresh world and context to where the run was saved; the tree follows in `run_episode`.

    Raises:
        UserError: What was saved is of another world, or not as this version writes it.
    """
    try:
        world.restore(saved.world.model_dump())
        if context.memory and saved.memory:
            context.memory.restore(saved.memory)
        for part, counted in ((context.policy, saved.policy), (context.checker, saved.checker)):
            if counted and hasattr(part, "restore"):
                part.restore(counted)
    except (KeyError, TypeError, ValueError) as error:
        raise UserError(f"the saved run cannot be continued here: {error!r:.200}") from None
    context.blackboard.clear()
    context.blackboard.update(saved.blackboard)
    log = context.log
    log.failures[:], log.queries[:], log.notices[:] = saved.failures, saved.queries, saved.notices
    log.replans[:], log.handoffs[:], log.diagnosis[:] = saved.replans, saved.handoffs, saved.diagnosis
    log.clipped = saved.clipped
