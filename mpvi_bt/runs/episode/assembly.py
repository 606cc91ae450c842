"""The parts of a run put together about a world, whether it is simulated here or is elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial

from mpvi_bt.executive.behaviors.context import Context
from mpvi_bt.executive.remote.remote_world import RemoteWorld
from mpvi_bt.executive.ticking.replanning import Replanner, things
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.relevant import task_relevant
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.finding.navigation.exploring import ExploringNavigator
from mpvi_bt.finding.navigation.navigator import KnownPlaceNavigator
from mpvi_bt.finding.scene.free_space import Standing
from mpvi_bt.ground.protocols import Policy
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.house.layout.house import House
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.runs.choices.backends import NOBODY
from mpvi_bt.runs.choices.checkers import make_checker, make_triggers
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.detectors import make_detector
from mpvi_bt.runs.choices.lateness import LateChecker, latency_of
from mpvi_bt.runs.choices.navigators import explorer, make_navigator, who_drives
from mpvi_bt.runs.choices.policies import (
    PolicyInputs,
    demonstrations,
    disturbed,
    in_chunks,
    make_policy,
    paced,
    with_pregrasp,
)
from mpvi_bt.runs.disturbances.answer_times import TimedPolicy
from mpvi_bt.runs.episode.prepare import Prepared, arrangement


@dataclass(frozen=True)
class RunParts:
    """What a run is made of.

    Attributes:
        navigator: Ours, which knows the map; drives the base unless the config names another.
        policy: Moves the arms.
        context: What behaviors are handed.
        took_s: Wall time of each of the policy's answers so far [s], where the config has `times`.
    """

    navigator: KnownPlaceNavigator
    policy: Policy
    context: Context
    took_s: list[float]


def assemble(
    config: EpisodeConfig,
    prepared: Prepared,
    tree: Tree,
    world: SimWorld | RemoteWorld,
    vocabulary: Mapping[str, Iterable[str]],
    house: House | None = None,
    make: Callable[[PolicyInputs], Policy] | None = None,
) -> RunParts:
    """Make the backends that a config chooses.

    Args:
        config: Which.
        prepared: What `prepare` made of it.
        tree: That is to run.
        world: The robot's.
        vocabulary: What the labels of pictures stand for.
        house: What is known of beforehand; None: nothing.
        make: Makes the policy; None: the one that `config` names is made.

    Raises:
        UserError: One of them cannot be made.
        ModelError: A language model cannot be asked.
    """
    skills = prepared.skills
    detector = make_detector(config.detector, vocabulary, config.seed)
    told = demonstrations() if config.planner == NOBODY else None
    truth = world if isinstance(world, SimWorld) else None
    task = prepared.task.problem if prepared.task else prepared.spec.name
    relevant = task_relevant(tree.spec, skills)
    if isinstance(world, SimWorld) and house is not None:
        navigator = make_navigator(config.detector, config.map, world, house, relevant, detector, config.seed)
    else:
        navigator = explorer(world, None, relevant, detector, config.map, config.seed)
    standing = _standing(config, navigator)
    ground = PolicyInputs(skills, vocabulary, detector.near, truth, config.seed, told, task, config.robot, standing)
    policy = make(ground) if make is not None else make_policy(config.policy, ground, config.policy_settings)
    timed = TimedPolicy(policy) if config.times is not None else None
    handed = disturbed(paced(in_chunks(timed or policy, config), config), config, skills, relevant)
    guided = _guided(config, prepared)
    judged = vocabulary if house is None else {**vocabulary, **floors(house)}
    checker = make_checker(config.checker, world, judged, config.seed, prepared.models, config.detector)
    context = Context(
        clock=world,
        robot=world.robot,
        navigator=who_drives(config.navigator, navigator, world, config.seed),
        policy=with_pregrasp(handed, ground, config.pregrasp_hand) if config.pregrasp else handed,
        checker=checker if config.latency is None else LateChecker(checker, latency_of(config, "checker")),
        triggers=make_triggers(config.trigger, world.robot),
        skills=skills,
        sense=navigator.feel if guided else lambda: None,
        memory=navigator if guided else None,
        while_asked=config.while_asked,
        calibration=prepared.calibration,
        blackboard=dict(tree.spec.blackboard),
    )
    if prepared.planner is not None:
        context.replanning = _replanning(prepared, config, tree, context, world, navigator)
    return RunParts(navigator, policy, context, timed.took_s if timed else [])


def _standing(config: EpisodeConfig, navigator: KnownPlaceNavigator) -> Standing | None:
    """What the navigator has seen to stand, for the policy of a base with corners.

    Our choice: its head does not see what such a base, and what it carries, meets when it turns or goes aside. Round
    ones go by what their policy has seen itself, as one does that is somewhere else.
    """
    wide = len(robot_named(config.robot).base.corners) > 0
    return navigator.mapper.occupancy.standing if wide and isinstance(navigator, ExploringNavigator) else None


def floors(house: House) -> dict[str, tuple[str, ...]]:
    """What floors are called, by their names in the world: judges are asked of them, nobody looks for them."""
    return {f"floor_{room.name}": ("floor", *(f"{p} floor" for p in room.phrases)) for room in house.rooms.values()}


def _guided(config: EpisodeConfig, prepared: Prepared) -> bool:
    """Whether the navigator has anything to do: to drive, or to know what new plans are told of."""
    return (config.drive == "navigator" and config.planner != NOBODY) or prepared.planner is not None


def _replanning(
    prepared: Prepared,
    config: EpisodeConfig,
    tree: Tree,
    context: Context,
    world: SimWorld | RemoteWorld,
    navigator: KnownPlaceNavigator,
) -> Replanner:
    """Makes the replanner. It plans from the robot's own knowledge, and new things in its plans are searched for."""
    assert prepared.planner is not None

    def full() -> tuple[str, ...]:
        felt = world.robot.proprioception()
        return tuple(side for side in felt.sides if felt.holds(side))

    replanning = partial(
        Replanner,
        prepared.planner,
        tree,
        context,
        prepared.task.instruction if prepared.task else "",
        drive=config.drive,
        arrange=arrangement(config, context.skills),
        late_s=latency_of(config, "planner", answers=1),  # the first is the plan itself
        full=full,
    )
    if not isinstance(navigator, ExploringNavigator):
        assert isinstance(world, SimWorld)
        return replanning(seen=lambda: things(world.knowledge()))
    discoveries = navigator.mapper.discoveries

    def look_for(spec: TreeSpec) -> None:
        discoveries.phrases = tuple(dict.fromkeys((*discoveries.phrases, *task_relevant(spec, context.skills))))

    known = discoveries.knowledge
    return replanning(seen=lambda: things(known), swapped=look_for)
