"""Makes the policy that a run chooses, by name or by name and address. Each is imported only when it is made."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpvi_bt.executive.plan.skills import Skill
from mpvi_bt.finding.perception.detector import Detector
from mpvi_bt.ground.errors import UnknownName, UserError, shown
from mpvi_bt.ground.protocols import Policy
from mpvi_bt.ground.robot.action_layout import ActionKind
from mpvi_bt.ground.robot.action_rows import check_rate
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, Side
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.runs.choices.backends import Choice, choose
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.detectors import make_detector
from mpvi_bt.runs.choices.lateness import draws_seed, latency_of

if TYPE_CHECKING:
    from mpvi_bt.executive.actions.backup import WithBackup
    from mpvi_bt.executive.actions.paced import PacedPolicy
    from mpvi_bt.executive.remote.dialect_settings import DialectSettings
    from mpvi_bt.executive.remote.observation import Vocabulary
    from mpvi_bt.finding.scene.free_space import Standing
    from mpvi_bt.hands.policies.scripted_policy import ScriptedPolicy

_REMOTE = (":openpi", ":vla_eval", ":lerobot", ":groot")  # factories of policies whose rate others say


@dataclass(frozen=True)
class PolicyInputs:
    """What policies may be made of.

    Attributes:
        skills: By name.
        vocabulary: What the labels of pictures stand for: label to phrases.
        detector: Of what policies see; None: the pictures' labels, by the vocabulary.
        world: The simulator's; None where there is none, as in a server. Only privileged policies may look at it.
        seed: Of everything random.
        demonstrations: Instruction to the prompts that it takes, where stand-ins for a VLA may be told whole
            instructions; None: they are told prompts.
        task: Name that BEHAVIOR has for it; None: not known here.
        robot: Name of the robot; None: not known here.
        standing: Says what who drives has seen to stand, for policies that see; None: nobody tells.
    """

    skills: Mapping[str, Skill]
    vocabulary: Mapping[str, Iterable[str]] = field(default_factory=dict)
    detector: Detector | None = None
    world: Any = None
    seed: int = 0
    demonstrations: Mapping[str, Sequence[str]] | None = None
    task: str | None = None
    robot: str | None = None
    standing: Standing | None = None


def demonstrations() -> dict[str, list[str]]:
    """What stand-ins for a VLA know of whole instructions: the order of the subtasks of the plans on file."""
    from mpvi_bt.executive.plan.planners import RecordedPlanner
    from mpvi_bt.executive.tree.compile import prompts_of

    return {plan.instruction: prompts_of(plan) for plan in RecordedPlanner().all()}


def make_policy(given: str, ground: PolicyInputs, settings: str | None = None) -> Policy:
    """The policy of a name, or of a name and an address. A remote one is connected to when it is first used.

    Args:
        given: Such as "reactive" or "openpi:ws://localhost:8000".
        ground: What it is made of.
        settings: Of a remote policy: name or file of how it is spoken to; its own default if None.

    Raises:
        UnknownName: There is no such policy, or there are no such settings.
        UserError: The address is none, the policy needs the simulator, or has no settings; or the settings are not of
            this task or this robot.
        FileProblems: Everything that is wrong with the settings.
    """
    choice = choose("policy", given)
    if choice.both is not None:
        return _with_backup(*choice.both, choice.only, ground, settings)
    if settings is not None and not choice.backend.address:
        raise UserError(
            f"policy {choice.name} has no settings: --policy-settings is of policies that are somewhere else."
        )
    if choice.backend.privileged and ground.world is None:
        raise UserError(f"policy {choice.name} reads the simulator itself, and there is none here.")
    made: Policy = choice.make(
        ground=ground,
        settings=settings,
        skills=ground.skills,
        vocabulary=ground.vocabulary,
        detector=ground.detector,
        seed=ground.seed,
    )
    return made


def for_clients(
    given: str,
    seed: int,
    settings: str | None = None,
    rate_hz: float | None = None,
    kind: ActionKind | None = None,
    detector: str = "segmentation",
) -> Callable[[Vocabulary], Policy]:
    """A factory of policies for a server: one for each client, made from its vocabulary, without a world.

    They know demonstrations: a client with the method e2e tells whole instructions, one with a tree prompts.

    Args:
        given, settings: As of `make_policy`.
        seed: Of everything random.
        rate_hz, kind: Of the policy's rows, before what it says itself.
        detector: By which policies of ours see, such as "learned" for clients that send no labels.

    Raises:
        UserError: There is no such detector, or it cannot be made.
    """
    from mpvi_bt.executive.actions.paced import PacedPolicy
    from mpvi_bt.executive.plan.skills import load_skills

    skills, known = load_skills(), demonstrations()

    def make(vocabulary: Vocabulary) -> Policy:
        seeing = make_detector(detector, vocabulary, seed).near
        ground = PolicyInputs(skills, vocabulary, seeing, seed=seed, demonstrations=known)
        made = make_policy(given, ground, settings)
        told_hz, said_by = _told_rate(made, rate_hz)
        return PacedPolicy(made, told_hz, kind, said_by, to_hz=None)

    return make


def in_chunks(policy: Policy, config: EpisodeConfig) -> Policy:
    """The policy, with its action chunks carried out as the config says."""
    from mpvi_bt.executive.actions.chunks import RecedingHorizon, TemporalEnsemble

    if config.policy_ensemble is not None:
        return TemporalEnsemble(policy, config.policy_ensemble)
    if config.policy_horizon is not None:
        return RecedingHorizon(policy, config.policy_horizon)
    return policy


def paced(policy: Policy, config: EpisodeConfig) -> PacedPolicy:
    """The policy, with its rows carried out at the rate that the config, a dataset or the policy says.

    Raises:
        UserError: It names a dataset that says none.
    """
    from mpvi_bt.executive.actions.paced import PacedPolicy

    rate_hz, said_by = _told_rate(policy, config.policy_rate)
    return PacedPolicy(policy, rate_hz, config.policy_actions, said_by)


def _told_rate(policy: Policy, given: float | None) -> tuple[float | None, str]:
    """The policy's rate, from the option or its dataset (None: neither), and the source's name. Raises UserError."""
    from mpvi_bt.executive.remote.dataset_rate import dataset_rate

    dataset = getattr(policy, "dataset", None)
    if given is None and dataset is not None and getattr(policy, "rate_hz", None) is None:
        return dataset_rate(Path(dataset)), f"the dataset {dataset}"
    return given, "--policy-rate"


def rate_doubt(config: EpisodeConfig) -> str:
    """One line for a person if it is not known how many rows a second the policy's actions are, or ""."""
    choice = choose("policy", config.policy)
    each = [one for one in choice.both or [choice] if one.part is not None or one.backend.factory.endswith(_REMOTE)]
    if not each or config.policy_rate is not None:
        return ""
    one = each[0]
    if one.part is not None:
        made = one.part.load()
        if any(getattr(made, name, None) is not None for name in ("rate_hz", "dataset")):
            return ""
        told = "unless it tells its `rate_hz`"
    elif one.name == "lerobot":
        chosen = make_policy(one.given, PolicyInputs({}, robot=config.robot), config.policy_settings)
        if getattr(chosen, "rate_hz", None) is not None:
            return ""
        told = "since the dataset of its training, which tells its rate, is not there"
    else:
        from mpvi_bt.executive.remote.dialect_settings import load_settings

        settings = config.policy_settings or _default_settings(one.name)
        if load_settings(settings).rate_hz is not None:
            return ""
        told = f"unless its server tells a rate, which the settings {settings} do not"
    return f"policy {one.given} runs at {CONTROL_HZ} Hz {told}; --policy-rate HZ sets the rate of its actions"


def _default_settings(policy: str) -> str:
    from mpvi_bt.executive.remote import groot, openpi, vla_eval

    return {"openpi": openpi.DEFAULT, "vla_eval": vla_eval.DEFAULT, "groot": groot.DEFAULT}[policy]


def disturbed(policy: Policy, config: EpisodeConfig, skills: Mapping[str, Skill], things: Sequence[str]) -> Policy:
    """The policy, with the faults and the latency that the config gives it.

    Args:
        policy: As it carries out its chunks: what is late is each answer.
        config: Of the episode.
        skills: By name.
        things: Phrases of the task's things.
    """
    from mpvi_bt.runs.disturbances.faults import read_faults
    from mpvi_bt.runs.disturbances.faulty_policy import FaultyPolicy
    from mpvi_bt.runs.disturbances.late_policy import LatePolicy
    from mpvi_bt.runs.disturbances.latency import read_latencies

    faults = read_faults(config.policy_faults) if config.policy_faults is not None else {}
    late_s = faults.pop("late", None)
    if faults:
        policy = FaultyPolicy(policy, faults, draws_seed(config), skills, things)
    if late_s is not None:
        policy = LatePolicy(policy, lambda answer: late_s)
    if config.latency is not None and "policy" in read_latencies(config.latency):
        policy = LatePolicy(policy, latency_of(config, "policy"), config.while_inferring)
    return policy


def with_pregrasp(policy: Policy, ground: PolicyInputs, hand: Side | None = None) -> Policy:
    """The policy, handed over to with the hand before what is to be picked up: `hand`, if the prompt names none."""
    from mpvi_bt.hands.policies.pregrasp import PregraspPolicy, WithPregrasp

    before = PregraspPolicy(
        ground.skills, ground.seed, time.perf_counter, ground.detector, ground.vocabulary, ground.standing,
        hand,
    )  # fmt: skip
    return WithPregrasp(policy, before)


def check_policy_choice(config: EpisodeConfig) -> None:
    """Refuse a choice of policy that cannot work, without a simulator or a connection.

    Raises:
        UnknownName: Of a skill that a policy is to use.
        UserError: As `make_policy`; or two ways to carry out chunks.
    """
    from mpvi_bt.executive.plan.skills import load_skills
    from mpvi_bt.house.instances.tasks import load_task

    choice = choose("policy", config.policy)
    check_pace(choice, config.policy_rate, config.policy_actions)
    for one in choice.both or [choice]:
        _check_cameras(one, config.robot)
    for name in choice.only or ():
        if name not in (known := load_skills()):
            raise UnknownName("skill", name, known)
    if config.policy_horizon is not None and config.policy_ensemble is not None:
        raise UserError("--policy-horizon and --policy-ensemble are two ways to carry out chunks: give one of them.")
    addressed = any(one.backend.address for one in choice.both or [choice])
    if (addressed and not choice.backend.privileged) or config.policy_settings is not None:
        task = load_task(config.task).problem if config.task else None
        make_policy(config.policy, PolicyInputs({}, task=task, robot=config.robot), config.policy_settings)


def _check_cameras(choice: Choice, robot: str) -> None:
    """Raise UserError if a class of somebody's own names a camera that the robot lacks. Its instances may name others.

    What is no tuple, such as a property, is read where the episode needs it.
    """
    cameras = getattr(choice.part.load(), "cameras", None) if choice.part is not None else None
    if not isinstance(cameras, tuple):
        return
    known = list(robot_named(robot).cameras)
    for camera in cameras:
        if camera not in known:
            has = f"`cameras` has {shown(camera)}, which the {robot} lacks"
            raise UserError(f"policy {choice.given}: {has}. Known: {', '.join(known)}.")


def check_pace(choice: Choice, rate_hz: float | None, kind: ActionKind | None) -> None:
    """Raise UserError if a rate or an action kind is invalid, or if the policy sets its own."""
    if rate_hz is not None:
        try:
            check_rate(rate_hz)
        except UserError as error:
            raise UserError(f"--policy-rate: {error}.") from None
    for option, given in (("--policy-rate", rate_hz), ("--policy-actions", kind)):
        if given is not None and choice.both is not None:
            raise UserError(f"{option} is of one policy; of two, each says it by its settings or its class.")
        if given is not None and choice.part is None and not choice.backend.factory.endswith(_REMOTE):
            raise UserError(
                f"{option} is of policies of your own or behind a server; {choice.name} acts once a control step, "
                f"{CONTROL_HZ} a second, and its joints are absolute."
            )


def expert(ground: PolicyInputs) -> Policy:
    """Scripted, by true poses."""
    from mpvi_bt.house.truth.expert import ExpertPolicy

    return _demonstrated(ExpertPolicy(ground.world, ground.skills, ground.seed, timer=time.perf_counter), ground)


def reactive(ground: PolicyInputs) -> Policy:
    """Scripted, by what the cameras show."""
    from mpvi_bt.hands.policies.reactive import ReactivePolicy

    made = ReactivePolicy(
        ground.skills, ground.seed, time.perf_counter, ground.detector, ground.vocabulary, ground.standing
    )
    return _demonstrated(made, ground)


def learned(ground: PolicyInputs, address: str) -> Policy:
    """By networks; the address is the file of their weights."""
    from mpvi_bt.finding.perception.segmentation import SegmentationDetector
    from mpvi_bt.hands.learned.policy import WEIGHTS, LearnedPolicy

    detector = ground.detector or SegmentationDetector(ground.vocabulary, least_px=1)
    return LearnedPolicy(ground.skills, detector, ground.seed, Path(address) if address else WEIGHTS)


def _with_backup(
    first: Choice, second: Choice, only: Sequence[str] | None, ground: PolicyInputs, settings: str | None
) -> Policy:
    """Two policies, the first of some skills `only`; the settings are of the first one if it alone can have some."""
    from mpvi_bt.executive.actions.backup import WithBackup

    if first == second:
        raise UserError(f"policy {first.given}+{second.given}: a policy cannot stand behind itself.")
    prompted = replace(ground, demonstrations=None)
    told = first.backend.factory.endswith(_REMOTE) and not second.backend.factory.endswith(_REMOTE)
    made = WithBackup(
        make_policy(first.given, prompted, settings if told else None),
        make_policy(second.given, prompted, None if told else settings),
        ground.skills,
        only,
    )
    return _demonstrated(made, ground)


def _demonstrated(policy: ScriptedPolicy | WithBackup, ground: PolicyInputs) -> Policy:
    """The policy, able to follow whole instructions if demonstrations are given."""
    from mpvi_bt.hands.policies.demonstrated import DemonstratedPolicy

    return policy if ground.demonstrations is None else DemonstratedPolicy(policy, ground.demonstrations)


def openpi(ground: PolicyInputs, address: str, settings: str | None) -> Policy:
    """Behind openpi's protocol."""
    from mpvi_bt.executive.remote.openpi import DEFAULT, OpenpiPolicy

    called = settings or DEFAULT
    return OpenpiPolicy(address, settings_for(called, ground.task, ground.robot), ground.vocabulary, called)


def vla_eval(ground: PolicyInputs, address: str, settings: str | None) -> Policy:
    """Behind a model server of the vla-eval package."""
    from mpvi_bt.executive.remote.vla_eval import DEFAULT, VlaEvalPolicy

    called = settings or DEFAULT
    return VlaEvalPolicy(address, settings_for(called, ground.task, ground.robot), ground.vocabulary, called)


def groot(ground: PolicyInputs, address: str, settings: str | None) -> Policy:
    """Behind GR00T's policy server."""
    from mpvi_bt.executive.remote.groot import DEFAULT, GrootPolicy

    called = settings or DEFAULT
    return GrootPolicy(address, settings_for(called, ground.task, ground.robot), called)


def lerobot(ground: PolicyInputs, address: str, settings: str | None) -> Policy:
    """A checkpoint of LeRobot's; the address is its folder, or that of LeRobot's server and the folder."""
    from mpvi_bt.executive.remote.dialect_settings import DialectSettings, load_settings
    from mpvi_bt.executive.remote.lerobot_policy import LerobotPolicy
    from mpvi_bt.executive.remote.lerobot_server import SCHEME, LerobotServerPolicy

    told = DialectSettings() if settings is None else load_settings(settings)
    if address.startswith(f"{SCHEME}://"):
        return LerobotServerPolicy(address, told, settings or "", ground.robot)
    return LerobotPolicy(Path(address).expanduser(), told, ground.robot)


def settings_for(given: str, task: str | None, robot: str | None) -> DialectSettings:
    """The settings of a remote policy, with what they need of a task filled in.

    Args:
        given: Name or file.
        task: Name that BEHAVIOR has for it; None: not known.
        robot: Name; None: not known.

    Raises:
        UserError: They do not exist, or are not of this task or this robot.
        FileProblems: Everything that is wrong with them.
    """
    from mpvi_bt.executive.remote.dialect_settings import load_settings
    from mpvi_bt.executive.remote.task_settings import check_robot, with_task
    from mpvi_bt.ground.human import human_stats
    from mpvi_bt.ground.robot.robots import robot_named

    settings = load_settings(given)
    if robot is not None:
        check_robot(settings, robot_named(robot), given)
        settings = settings.model_copy(update={"robot": robot})
    known = human_stats().get(task or "")
    return with_task(settings, task, None if known is None else known.task_id)
