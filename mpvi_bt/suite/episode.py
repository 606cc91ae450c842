"""One episode from its config to its result: the place where the parts are chosen and put together."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from typing import Any

from mpvi_bt.behaviors.context import Context
from mpvi_bt.behaviors.protocols import Policy
from mpvi_bt.completion.oracle import OracleChecker
from mpvi_bt.executive.demonstration import Demonstration
from mpvi_bt.executive.loop import Last, Subscriber, run_episode
from mpvi_bt.executive.pictures import PathPicture
from mpvi_bt.executive.recorder import Recorder
from mpvi_bt.executive.replanning import Replanning, things
from mpvi_bt.executive.rerun_log import RerunLog
from mpvi_bt.executive.saved import restore_world
from mpvi_bt.executive.stop import Stop
from mpvi_bt.executive.video import Video
from mpvi_bt.goals.evaluate import GoalReport, judge, snapshot
from mpvi_bt.goals.predicates import truth_in
from mpvi_bt.navigation.exploring import ExploringNavigator
from mpvi_bt.navigation.navigator import KnownPlaceNavigator
from mpvi_bt.perception.map import OccupancyMap
from mpvi_bt.plan.planners import Planner
from mpvi_bt.robot.robots import robot_named
from mpvi_bt.sim.catalogue import load_catalogue
from mpvi_bt.sim.house import House, load_house
from mpvi_bt.sim.prior_map import prior_map
from mpvi_bt.sim.sampling import Start
from mpvi_bt.sim.world import World
from mpvi_bt.suite.backends import NOBODY, choose
from mpvi_bt.suite.checkers import make_checker, make_triggers
from mpvi_bt.suite.config import EpisodeConfig
from mpvi_bt.suite.detectors import make_detector
from mpvi_bt.suite.instances import begin, expanded_problem
from mpvi_bt.suite.metrics import Meter
from mpvi_bt.suite.navigators import make_navigator
from mpvi_bt.suite.policies import Ground, demonstrations, in_chunks, make_policy
from mpvi_bt.suite.prepare import Prepared, prepare_episode
from mpvi_bt.suite.queries import count_queries
from mpvi_bt.suite.result import Failure, Grasps, Planning, Replanned, make_result
from mpvi_bt.suite.saved import Keeper, SavedEpisode
from mpvi_bt.suite.simulators import begin_elsewhere
from mpvi_bt.suite.tasks import Task
from mpvi_bt.suite.truth import Audit, TrueState
from mpvi_bt.tree.build import Tree
from mpvi_bt.tree.compile import Drive
from mpvi_bt.tree.relevant import task_relevant
from mpvi_bt.tree.spec import TreeSpec
from mpvi_bt.tree.substitute import stand_ins

_LABELS = ("oracle", "segmentation")  # policies that see have a detector of labels of their own, for what is near


def run(
    config: EpisodeConfig,
    subscribers: Sequence[Subscriber] = (),
    prepared: Prepared | None = None,
    stop: Stop | None = None,
    begun: tuple[World, Start] | None = None,
    make: Callable[[Ground], Policy] | None = None,
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
    prepared = prepared or prepare_episode(config)
    task, skills = prepared.task, prepared.skills
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
    truth = truth_in(world, start.scene_names)
    before = snapshot(problem, truth)
    places = _places(world)
    vocabulary = {e.name: e.phrases for e in world.knowledge() if e.kind != "room"}
    judged = vocabulary | _floors(house)
    detector = make_detector(config.detector, vocabulary, config.seed)
    seeing = None if detector.name in _LABELS else detector
    told = demonstrations() if config.planner == NOBODY else None
    ground = Ground(skills, vocabulary, seeing, world, config.seed, told, task.problem, config.robot)
    policy = make(ground) if make is not None else make_policy(config.policy, ground, config.policy_settings)
    relevant = task_relevant(tree.spec, skills)
    navigator = make_navigator(config.detector, config.map, world, house, relevant, detector, config.seed)
    guided = _guided(config, prepared)
    context = Context(
        clock=world,
        robot=world.robot,
        navigator=navigator,
        policy=in_chunks(policy, config),
        checker=make_checker(config.checker, world, judged, config.seed, prepared.models),
        triggers=make_triggers(config.trigger, world.robot),
        skills=skills,
        sense=navigator.feel if guided else lambda: None,
        memory=navigator if guided else None,
        while_asked=config.while_asked,
        blackboard=dict(tree.spec.blackboard),
    )
    if prepared.planner is not None:
        context.replanning = _replanning(prepared.planner, tree, context, task, world, config.drive)
    saved = prepared.saved
    if saved is not None:
        restore_world(saved.run, world, context)
    meter = Meter(saved.measurement if saved else None)
    audit = Audit(OracleChecker(TrueState(world), judged), saved.truths if saved else ())
    last = Last()
    demonstration = _demonstration(config, task)
    watchers = [
        meter,
        audit,
        last,
        *demonstration,
        *_recorders(config, prior_map(house), world, navigator, saved),
        *subscribers,
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
            Failure(node=f.path, reason=f.reason, feedback=f.evidence, time_s=f.time_s)
            for f in (*outcome.log.failures, *filter(None, [outcome.failure]))
        ],
        replans=[
            Replanned(node=r.path, segments=r.segments, said=r.said, time_s=r.time_s) for r in outcome.log.replans
        ],
        clipped=outcome.log.clipped,
        grasps=Grasps.model_validate(Counter(notice.kind for notice in outcome.log.notices)),
        queries=count_queries(outcome.log.queries, audit.truths, tree.spec),
        planning=Planning.of(prepared.planned),
        things={name: [places[name], place] for name, place in _places(world).items() if name in places},
        wall={
            "total_s": total,
            "setup_s": ready - began,
            "loop": dict(outcome.wall_s),
            "planning_s": getattr(policy, "planning_s", 0.0),
        },
    )
    for recorded in demonstration:
        recorded.conclude(result.q, result.success)
    return result.model_dump(mode="json")


def _floors(house: House) -> dict[str, tuple[str, ...]]:
    """What floors are called, by their names in the world: judges are asked of them, nobody looks for them."""
    return {f"floor_{room.name}": ("floor", *(f"{p} floor" for p in room.phrases)) for room in house.rooms.values()}


def _places(world: World) -> dict[str, list[float]]:
    """Where each movable thing is, x and y in the world [m], to whole centimetres."""
    return {e.name: [round(float(c), 2) for c in e.center[:2]] for e in world.knowledge() if e.kind == "object"}


def _guided(config: EpisodeConfig, prepared: Prepared) -> bool:
    """Whether the navigator has anything to do: to drive, or to know what new plans are told of."""
    return (config.drive == "navigator" and config.planner != NOBODY) or prepared.planner is not None


def _replanning(planner: Planner, tree: Tree, context: Context, task: Task, world: World, drive: Drive) -> Replanning:
    """What makes new plans, of what the robot itself has seen; what they name is looked for from then on."""
    navigator = context.navigator
    if not isinstance(navigator, ExploringNavigator):
        return Replanning(planner, tree, context, task.instruction, lambda: things(world.knowledge()), drive=drive)
    discoveries = navigator.lookout.discoveries

    def look_for(spec: TreeSpec) -> None:
        discoveries.phrases = tuple(dict.fromkeys((*discoveries.phrases, *task_relevant(spec, context.skills))))

    known = discoveries.knowledge
    return Replanning(planner, tree, context, task.instruction, lambda: things(known), look_for, drive=drive)


def _renders(config: EpisodeConfig) -> bool:
    """Whether anything in the episode looks at pictures."""
    looking = (choose(kind, name).sees for kind, name in config.backends.items())
    outputs = (config.video, config.rerun, config.demonstration)
    return any(output is not None for output in outputs) or any(looking)


def _demonstration(config: EpisodeConfig, task: Task) -> list[Demonstration]:
    if config.demonstration is None:
        return []
    about = {"task": config.task_name, "instance": config.instance, "seed": config.seed, "config": config.record()}
    about["instruction"] = task.instruction
    return [Demonstration(config.demonstration, about, config.demonstration_fps)]


def _recorders(
    config: EpisodeConfig, grid: OccupancyMap, world: World, navigator: KnownPlaceNavigator, saved: SavedEpisode | None
) -> list[Subscriber]:
    recorders: list[Subscriber] = []
    search = navigator if isinstance(navigator, ExploringNavigator) else None
    if config.trace is not None:
        recorders.append(Recorder(config.trace, config.record(), config.seed, saved.run if saved else None))
    if config.video is not None:
        recorders.append(Video(config.video, config.name, search=search))
    if config.rerun is not None:
        recorders.append(RerunLog(config.rerun, grid, config.name, search))
    if config.picture is not None:
        recorders.append(
            PathPicture(config.picture, grid, world.knowledge, lambda: navigator.goal, config.name, search)
        )
    return recorders
