"""One episode from its config to its result: the place where the parts are chosen and put together."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from typing import Any

from mpvi_bt.executive.completion.oracle import OracleChecker
from mpvi_bt.executive.ticking.goal_report import GoalReport
from mpvi_bt.executive.ticking.loop import Last, Subscriber, run_episode
from mpvi_bt.executive.ticking.saved_run import restore_world
from mpvi_bt.executive.ticking.stop import Stop
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.substitute import stand_ins
from mpvi_bt.finding.navigation.exploring import ExploringNavigator
from mpvi_bt.finding.navigation.navigator import KnownPlaceNavigator
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.protocols import Policy
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.ground.writing import write_whole
from mpvi_bt.house.goals.evaluate import judge, snapshot
from mpvi_bt.house.goals.predicates import truth_in
from mpvi_bt.house.instances.instances import begin, expanded_problem
from mpvi_bt.house.instances.sampling import Start
from mpvi_bt.house.instances.tasks import Task
from mpvi_bt.house.layout.house import load_house
from mpvi_bt.house.layout.prior_map import prior_map
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.things.catalogue import load_catalogue
from mpvi_bt.runs.choices.backends import choose, eyes_of
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.policies import PolicyInputs
from mpvi_bt.runs.choices.simulators import begin_elsewhere
from mpvi_bt.runs.choices.world_truth import Audit, TrueState
from mpvi_bt.runs.disturbances.answer_times import measured_times
from mpvi_bt.runs.episode.assembly import assemble, floors
from mpvi_bt.runs.episode.disturbed import actions_of, faults_of, lateness_of
from mpvi_bt.runs.episode.metrics import Meter
from mpvi_bt.runs.episode.prepare import Prepared, prepare_episode
from mpvi_bt.runs.episode.queries import count_queries, with_truth
from mpvi_bt.runs.episode.result import FailureRecord, Grasps, Planning, PolicyShare, ReplanRecord, make_result
from mpvi_bt.runs.episode.saved_episode import Keeper, SavedEpisode
from mpvi_bt.runs.recording.demonstration_recorder import DemonstrationRecorder
from mpvi_bt.runs.recording.mcap_log import McapLog
from mpvi_bt.runs.recording.path_picture import PathPicture
from mpvi_bt.runs.recording.profile import Profile
from mpvi_bt.runs.recording.recorder import Recorder
from mpvi_bt.runs.recording.rerun_log import RerunLog
from mpvi_bt.runs.recording.video import Video


def run(
    config: EpisodeConfig,
    subscribers: Sequence[Subscriber] = (),
    prepared: Prepared | None = None,
    stop: Stop | None = None,
    begun: tuple[SimWorld, Start] | None = None,
    make: Callable[[PolicyInputs], Policy] | None = None,
) -> dict[str, Any]:
    """Run one episode.

    Args:
        config: What to run. The same config gives the same result, wall times apart.
        subscribers: Who watches besides the meter and what `config` asks for.
        prepared: What `prepare_episode` made of `config`, if that was called before.
        stop: Ends the episode between two ticks; it takes Ctrl-C over meanwhile.
        begun: A world that stands at its start, and the start, as of `instances.begin`; None: it is made here.
        make: Makes the policy; None: the one that `config` names is made.

    Returns:
        The result, ready for JSON. Ctrl-C gives one too, its "ended" being "interrupted", and so does a policy's server
        or a language model that fails: "backend_error".

    Raises:
        UserError: Something in `config` does not exist or is wrong.
        NoRenderingDevice: A picture is needed on a machine that can draw none.
        NodeError: A behavior raised.
    """
    began = time.perf_counter()
    profiles = [] if config.profile is None else [Profile(config.profile)]
    prepared = prepared or prepare_episode(config)
    task = prepared.task
    assert task is not None
    tree = Tree(prepared.spec, stand_ins(prepared.rules))
    house, catalogue = load_house(task.house), load_catalogue()
    problem = expanded_problem(task, house)
    if begun is not None:
        world, start = begun
    elif config.sim == "sapien":
        world, start = begin(
            task, house, catalogue, problem, config.instance, config.split, render=_renders(config),
            assisted=config.assisted, robot=robot_named(config.robot),
        )  # fmt: skip
    else:
        world, start = begin_elsewhere(config, _renders(config))
    if world.cameras is not None:
        world.cameras.labels = "labels" in eyes_of(config.backends).values()
    truth = truth_in(world, start.scene_names)
    before = snapshot(problem, truth)
    places = _places(world)
    vocabulary = {e.name: e.phrases for e in world.knowledge() if e.kind != "room"} | world.phrases
    parts = assemble(config, prepared, tree, world, vocabulary, house, make)
    navigator, policy, context = parts.navigator, parts.policy, parts.context
    saved = prepared.saved
    if saved is not None:
        restore_world(saved.run, world, context)
    meter = Meter(saved.measurement if saved else None)
    audit = Audit(OracleChecker(TrueState(world), vocabulary | floors(house)), saved.truths if saved else ())
    last = Last()
    demonstration = _demonstration(config, task)
    watchers = [
        meter,
        audit,
        last,
        *demonstration,
        *_recorders(config, prior_map(house), world, navigator, saved),
        *subscribers,
        *profiles,
    ]

    def score() -> GoalReport:
        world.settle()  # what was let go of in the last step is still falling
        return judge(problem, before, snapshot(problem, truth))

    ready = time.perf_counter()
    try:
        with stop or nullcontext(lambda: False) as asked:
            keeper = Keeper(asked, config, tree, world, meter, audit)
            outcome = run_episode(
                tree, world, context, watchers, task.budget_s, stop=keeper, saved=saved.run.tree if saved else None,
                score=score,
            )  # fmt: skip
    except KeyboardInterrupt:
        outcome = last.outcome
    finally:
        getattr(policy, "close", lambda: None)()
    goal = outcome.goal or score()
    total = time.perf_counter() - began
    result = make_result(
        config,
        task,
        goal,
        meter.measurement,
        ended=outcome.ending,
        failures=[
            FailureRecord(node=f.path, reason=f.reason, feedback=f.evidence, time_s=f.time_s)
            for f in (*outcome.log.failures, *filter(None, [outcome.failure]))
        ],
        replans=[
            ReplanRecord(node=r.path, segments=r.segments, said=r.said, time_s=r.time_s) for r in outcome.log.replans
        ],
        clipped=outcome.log.clipped,
        grasps=Grasps.model_validate(Counter(notice.kind for notice in outcome.log.notices)),
        queries=count_queries(outcome.log.queries, audit.truths, tree.spec),
        planning=Planning.of(prepared.planned),
        policies=_shares(policy),
        faults=faults_of(context.policy),
        actions=actions_of(context.policy),
        lateness=lateness_of(context.policy),
        handoffs=outcome.log.handoffs,
        diagnosis=with_truth(outcome.log.diagnosis, outcome.log.queries, audit.truths),
        things={name: [places.get(name, place), place] for name, place in _places(world).items()},
        wall={
            "total_s": total,
            "setup_s": ready - began,
            "loop": dict(outcome.wall_s),
            **({"doing": profiles[0].seconds} if profiles else {}),
            "planning_s": getattr(policy, "planning_s", 0.0),
            "answers": [{"mean_s": h.wall_mean_s, "most_s": h.wall_most_s} for h in outcome.log.diagnosis],
        },
    )
    if config.times is not None:
        planner_s = prepared.planned.latency_s if prepared.planned else None
        times = measured_times(parts.took_s, outcome.log, planner_s)
        write_whole(config.times, json.dumps(times))
    for recorded in demonstration:
        recorded.conclude(result.q, result.success)
    return result.model_dump(mode="json")


def _shares(policy: Policy) -> dict[str, PolicyShare]:
    """What each of two policies did; empty of one."""
    prompts, steps = getattr(policy, "prompts", {}), getattr(policy, "steps", {})
    return {name: PolicyShare(prompts=prompts.get(name, 0), steps=n) for name, n in steps.items()}


def _places(world: SimWorld) -> dict[str, list[float]]:
    """Where each movable thing is, x and y in the world [m], to whole centimeters."""
    return {e.name: [round(float(c), 2) for c in e.center[:2]] for e in world.knowledge() if e.kind == "object"}


def _renders(config: EpisodeConfig) -> bool:
    """Whether anything in the episode looks at pictures."""
    looking = (choose(kind, name).backend.sees for kind, name in config.backends.items())
    outputs = (config.video, config.rerun, config.mcap, config.demonstration)
    return any(output is not None for output in outputs) or any(looking)


def _demonstration(config: EpisodeConfig, task: Task) -> list[DemonstrationRecorder]:
    if config.demonstration is None:
        return []
    about = {"task": config.task_name, "instance": config.instance, "seed": config.seed, "config": config.record()}
    about |= {"problem": task.problem, "instruction": task.instruction}
    return [DemonstrationRecorder(config.demonstration, about, config.demonstration_fps)]


def _recorders(
    config: EpisodeConfig,
    grid: OccupancyMap,
    world: SimWorld,
    navigator: KnownPlaceNavigator,
    saved: SavedEpisode | None,
) -> list[Subscriber]:
    recorders: list[Subscriber] = []
    search = navigator if isinstance(navigator, ExploringNavigator) else None
    if config.trace is not None:
        recorders.append(Recorder(config.trace, config.record(), config.seed, saved.run if saved else None))
    if config.video is not None:
        parts = ", ".join(f"{kind} {name}" for kind, name in config.backends.items())
        recorders.append(Video(config.video, config.name, parts, search=search, only_failures=config.only_failures))
    if config.rerun is not None:
        recorders.append(RerunLog(config.rerun, grid, config.name, search))
    if config.mcap is not None:
        recorders.append(McapLog(config.mcap, grid, search))
    if config.picture is not None:
        recorders.append(
            PathPicture(config.picture, grid, world.knowledge, lambda: navigator.goal, config.name, search)
        )
    return recorders
