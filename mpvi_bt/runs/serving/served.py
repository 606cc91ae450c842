"""The executive behind a socket, for a robot elsewhere: from a requested episode to its result."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mpvi_bt.executive.plan.planners import RecordedPlanner
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.remote.driven import DrivenSession
from mpvi_bt.executive.remote.own_keys import OwnKeys
from mpvi_bt.executive.remote.reading import Dialect, Reading
from mpvi_bt.executive.remote.remote_world import RemoteWorld
from mpvi_bt.executive.remote.server import SocketServer
from mpvi_bt.executive.ticking.loop import Last, Outcome, Subscriber, run_episode
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.compile import compile_instruction, compile_plan
from mpvi_bt.executive.tree.relevant import task_relevant
from mpvi_bt.executive.tree.substitute import stand_ins
from mpvi_bt.finding.navigation.exploring import ExploringNavigator
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import BadMessage, NodeError, UserError, nearest, shown
from mpvi_bt.ground.human import task_of_id
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.hands.behavior_robot.behavior import Behavior
from mpvi_bt.hands.behavior_robot.behavior_layout import BODY, TYPE
from mpvi_bt.runs.choices.backends import NOBODY, choose, eyes_of, privileged
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.language_models import Models
from mpvi_bt.runs.choices.planning import make_planner
from mpvi_bt.runs.episode.assembly import assemble
from mpvi_bt.runs.episode.capability_checks import check_hands
from mpvi_bt.runs.episode.prepare import Prepared, arrangement, check_backends, prepare
from mpvi_bt.runs.episode.result import write_json
from mpvi_bt.runs.episode.unscored_result import unscored_result
from mpvi_bt.runs.recording.mcap_log import McapLog
from mpvi_bt.runs.recording.recorder import Recorder

_PARTING_S = 5.0  # for the results of episodes that the end cuts off
NAME = "mpvi"  # of what is served
_SPOKEN: tuple[Dialect, ...] = (Behavior("behavior-2025"), Behavior("behavior-2026"), OwnKeys())
DIALECTS: Mapping[str, Dialect] = {dialect.name: dialect for dialect in _SPOKEN}


@dataclass(frozen=True)
class ServedWork:
    """Work fixed at the start of the server; the rest comes with observations.

    Attributes:
        config: Of every episode; its task, tree or plan are done whatever observations say.
        instruction: Likewise; "": what observations say.
        out: Folder for results and traces; None: none are written.
    """

    config: EpisodeConfig
    instruction: str = ""
    out: Path | None = None


def executive_server(
    dialect: str, work: ServedWork, api_key: str = "", say: Callable[[str], None] = lambda line: None
) -> SocketServer:
    """The whole executive behind a socket; each client has its own.

    Args:
        dialect: What clients speak: "behavior-2025", "behavior-2026", "openpi".
        work: What is to be done.
        api_key, say: As of `SocketServer`.

    Raises:
        UserError: A backend does not exist or reads a simulator, or what is to be done cannot be.
        ModelError: A language model cannot be asked.
    """
    config = work.config
    check_robot(dialect, config.robot)
    check_work(work, say)
    numbers = itertools.count(1)

    def open_() -> DrivenSession:
        def play_next(first: Reading, world: RemoteWorld) -> str:
            return play(work, first, world, next(numbers), say)

        return DrivenSession(DIALECTS[dialect], robot_named(config.robot), play_next, say)

    # No pong is waited for: an evaluator that loads a scene may answer nothing for minutes.
    return SocketServer(NAME, open_, api_key, say, idle_s=None, pong_s=None, parting_s=_PARTING_S)


def check_work(work: ServedWork, say: Callable[[str], None]) -> None:
    """Find out before an episode begins whether it can be played on a robot elsewhere.

    Raises:
        UserError: A backend does not exist or reads a simulator, or what is to be done cannot be.
        ModelError: A language model cannot be asked.
    """
    config = work.config
    check_backends(config)
    if reading := privileged(config.backends):
        raise UserError(f"{reading[0].replace(':', ' ')} reads the simulator itself, and there is none here.")
    if config.map != "online":
        raise UserError(f"map {config.map} is of a house that is known; here it is not: choose --map online.")
    if work.instruction or config.task or config.tree or config.plan:
        prepared_for(work, None, say)


def check_robot(dialect: str, robot: str) -> None:
    """Raise UserError if a dialect has no numbers for a robot."""
    if dialect != OwnKeys.name and robot != BODY:
        raise UserError(f"{dialect} is of BEHAVIOR's {TYPE}, not of the {robot}: choose --robot {BODY}.")


def play(work: ServedWork, first: Reading, world: RemoteWorld, number: int, say: Callable[[str], None]) -> str:
    """Play one episode; how it ended, in a line.

    Args:
        work: What is to be done.
        first: The observation that it begins with.
        world: The robot's, which stands at it.
        number: Of the episode, in the names of its files.
        say: Told what is begun.

    Raises:
        As `play_episode`.
    """
    prepared, outcome, _ = play_episode(
        work, first, world, f"served_{number}", lambda line: say(f"episode {number}: {line}")
    )
    return f"episode {number}: {_told(outcome, prepared)}"


def play_episode(
    work: ServedWork,
    first: Reading,
    world: RemoteWorld,
    stem: str,
    say: Callable[[str], None],
    watchers: Sequence[Subscriber] = (),
    stop: Callable[[], bool] = lambda: False,
    more: Callable[[], Mapping[str, Any]] = dict,
) -> tuple[Prepared, Outcome, dict[str, Any]]:
    """Play one episode; what was prepared for it, how it ended, and its result.

    Args:
        work: What is to be done.
        first: The observation that it begins with.
        world: The robot's, which stands at it.
        stem: Of its files, after the name of what is done.
        say: Told what is begun.
        watchers: Who watches besides.
        stop: Ends it between two ticks.
        more: What the result tells besides.

    Raises:
        UserError: It cannot be begun.
        ModelError: A language model makes no plan.
        NodeError: A behavior raised.
        BadMessage: An observation is none.
        KeyboardInterrupt: It was ended from outside.
    """
    config, prepared = prepared_for(work, first, say)
    if task_relevant(prepared.spec, prepared.skills):  # else nobody looks for anything
        _check_sight(config, first)
    name = prepared.spec.name
    stem = f"{name}_{stem}"
    if work.out is not None:
        config = replace(config, trace=work.out / f"{stem}.trace.jsonl")
    say(name)
    tree = Tree(prepared.spec, stand_ins(prepared.rules))
    parts = assemble(config, prepared, tree, world, first.vocabulary or {})
    last = Last()
    own: list[Subscriber] = [last]
    if config.trace is not None:
        own.append(Recorder(config.trace, config.record(), config.seed))
    if config.mcap is not None:
        search = parts.navigator if isinstance(parts.navigator, ExploringNavigator) else None
        own.append(McapLog(config.mcap, search=search, looks=False))
    wrong: dict[str, Any] = {}
    result: dict[str, Any] = {}
    try:
        outcome = run_episode(tree, world, parts.context, [*own, *watchers], max_time_s=float("inf"), stop=stop)
    except (NodeError, BadMessage) as error:
        wrong = {"error": str(error)}
        raise
    finally:
        getattr(parts.policy, "close", lambda: None)()
        result = {**unscored_result(config, prepared, last.outcome), **wrong, **more()}
        if work.out is not None:
            write_json(work.out / f"{stem}.json", result)
    return prepared, outcome, result


def _told(outcome: Outcome, prepared: Prepared) -> str:
    why = f": {outcome.failure.reason}: {outcome.failure.evidence}" if outcome.failure else ""
    return f"{outcome.told(prepared.spec)}{why}"


def prepared_for(
    work: ServedWork, first: Reading | None, tell: Callable[[str], None]
) -> tuple[EpisodeConfig, Prepared]:
    """The config of an episode, and what it is about to run.

    What is said where the server starts comes first, then the number of the task, then the instruction.

    Raises:
        UserError: Nobody says what is to be done, or it cannot be.
        ModelError: A language model makes no plan.
    """
    config = work.config
    if config.tree or config.plan:
        return config, prepare(replace(config, task=""), tell)
    name, instruction = config.task, work.instruction
    if not name and not instruction and first is not None:
        if first.task is not None:
            name = task_of_id(first.task)
        else:
            instruction = first.instruction
    if name and name not in paths.names("tasks") and not paths.is_file(Path(name)):
        plan = RecordedPlanner().plan(name)
        if choose("planner", config.planner).name == "recorded":
            config = replace(config, plan=name)
            return config, prepare(config, tell)
        instruction = plan.instruction
    elif name:
        config = replace(config, task=name)
        return config, prepare(config, tell)
    if not instruction:
        raise UserError("nobody says what is to be done: neither the observation nor --task or --instruction.")
    return config, _instructed(config, name or "instruction", instruction, tell)


def _instructed(config: EpisodeConfig, name: str, instruction: str, tell: Callable[[str], None]) -> Prepared:
    """What carries an instruction out."""
    skills, models = load_skills(), Models(config)
    planner = None
    if config.planner == NOBODY:
        return Prepared(None, skills, compile_instruction(name, instruction), None, models)
    if choose("planner", config.planner).name == "recorded":
        plans = {plan.instruction: plan for plan in RecordedPlanner().all()}
        if instruction not in plans:
            near = nearest(instruction, plans)
            hint = f" Did you mean {shown(near)}?" if near else ""
            raise UserError(
                f"no plan is on file for {shown(instruction)}: choose a planner that makes one, such as "
                f"--planner openai:MODEL.{hint}"
            )
        plan, planned = plans[instruction], None
    else:
        planner = make_planner(config, None, models, tell=tell)
        planned = planner.ask(name, instruction)
        plan = planned.plan
    spec = compile_plan(plan, skills, config.on_failure, config.drive, arrangement(config, skills))
    check_hands(config.robot, spec, skills)
    return Prepared(None, skills, spec, None, models, planned, planner=planner)


def _check_sight(config: EpisodeConfig, first: Reading) -> None:
    """Raise UserError if a backend reads labels of pictures, and there are none."""
    if any(image.labels is not None for image in first.images.values()) or not first.images:
        return
    for kind, eyes in eyes_of(config.backends).items():
        choice = choose(kind, getattr(config, kind))
        if eyes == choice.backend.eyes == "labels" and choice.part is None:
            raise UserError(
                f"{kind} {choice.name} reads labels of pictures, which this client does not send: choose another, such "
                f"as --{kind} learned."
            )
