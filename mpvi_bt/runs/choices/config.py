"""Settings of one episode. Light: worker processes receive it, and the command line loads it at once.

This is the one home of a setting: its name, type, default, bounds and help. Methods, saved episodes, the keywords of
`mpvi_bt.run` and the options of commands are made of the fields here, by `settings.py` and
`apps/cli/setting_options.py`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from inspect import cleandoc
from pathlib import Path
from typing import Any, Literal

from mpvi_bt.ground import paths
from mpvi_bt.ground.robot.default_robot import DEFAULT_ROBOT

EPISODE = "mpvi_bt.runs.episode.episode:run"  # the function that runs one


@dataclass(frozen=True)
class Setting:
    """What there is to know of a setting besides its name, type and default.

    Attributes:
        help: What it does.
        metavar: What stands for its value in the help of its option.
        least: At least that number.
        folder: Where names of it are found, such as "trees"; "": it is a file; None: it is neither.
        reader: "module:function" that reads it, and raises UserError where it cannot.
        begins: How a part of it may begin.
    """

    help: str
    metavar: str | None = None
    least: int | None = None
    folder: str | None = None
    reader: str = ""
    begins: tuple[str, ...] = ()


def setting(default: Any, help: str, metavar: str | None = None, **more: Any) -> Any:
    """A field with that default; the others as of `Setting`."""
    return field(default=default, metadata={"setting": Setting(help, metavar, **more)})


@dataclass(frozen=True)
class InstanceSettings:
    """Which episode it is.

    Attributes:
        task: Name of a task (tasks/*.yaml), or the file of one.
        method: Name of the method that settings come from (tasks/methods/*.yaml), or None; the settings themselves say
            what was run.
    """

    task: str
    instance: int = setting(0, "Start state of the task.", least=0)
    seed: int = setting(0, "Seed of everything random.", least=0)
    split: Literal["public", "hidden"] = setting(
        "public", "Set of instances. Hidden ones are drawn from the secret in MPVI_HIDDEN_SEED."
    )
    house: str | None = setting(
        None,
        "House to play in, by name, by file, or generated:SEED or generated:KIND:SEED for one that a seed draws.  "
        "[default: the task's]",
        "HOUSE",
        reader="mpvi_bt.house.layout.house_names:check_house_name",
        begins=("generated:",),
    )
    method: str | None = None


@dataclass(frozen=True, kw_only=True)
class PlanSettings:
    """Who plans, and how the plan becomes a tree."""

    planner: str = setting("recorded", "Who makes the plan.", "NAME")
    drive: Literal["navigator", "policy"] = setting(
        "navigator", "Who drives: the navigator, or the policy, with the segment's description as its prompt."
    )
    on_failure: str = setting(
        "advance",
        "After a unit of the plan has failed: advance: go on with the next one; retry:N: try it N more times first; "
        "replan: have the planner make a new plan for the rest (recorded: go on, and try the unit again at the end).",
        "WHAT",
        reader="mpvi_bt.executive.tree.compile:parse_on_failure",
        begins=("advance", "retry:", "replan"),
    )
    unit: str | None = setting(
        None,
        "Run each unit of manipulation in this tree, such as monitored or intervene.",
        "TREE",
        folder="trees",
    )
    calibration: str | None = setting(
        None, "Thresholds of the monitors, as `mpvi calibrate` writes them.", "FILE", folder=""
    )


@dataclass(frozen=True, kw_only=True)
class PerceptionSettings:
    """The map known at the start, and the backends that find things and drive."""

    map: str = setting("prior", "The map of the house at the start.", "NAME")
    detector: str = setting("segmentation", "Who finds things.", "NAME")
    navigator: str = setting("grid", "Who drives the base.", "NAME")


@dataclass(frozen=True, kw_only=True)
class PolicySettings:
    """Who moves the hands, and how it is asked."""

    policy: str = setting("expert", "Who moves the hands.", "NAME")
    policy_settings: str | None = setting(
        None, "Settings of a policy server, by name or file.", "NAME", folder="policies"
    )
    policy_horizon: int | None = setting(
        None, "Execute N actions of each chunk, then ask again.  [default: all]", "N", least=1
    )
    policy_ensemble: float | None = setting(
        None, "Ask at every step, and average overlapping chunks with weights exp(-DECAY i).", "DECAY", least=0
    )
    policy_rate: float | None = setting(
        None,
        "Rows of actions a second; it overrides the policy's settings, its dataset, its server and the policy itself.  "
        "[default: 30, if none of them has a rate]",
        "HZ",
        least=1,
    )
    policy_actions: Literal["absolute", "delta", "velocity"] | None = setting(
        None,
        "Meaning of the joints in a row of actions: targets, changes in each row, or speeds.  [default: absolute, if "
        "the policy does not say]",
    )
    pregrasp: bool = setting(
        False, "Before a handoff, bring the hand close to the object to pick up, by a planned motion."
    )
    pregrasp_hand: Literal["left", "right"] | None = setting(
        None, "With --pregrasp: this hand, if the prompt names none.  [default: the one on the object's side]"
    )


@dataclass(frozen=True, kw_only=True)
class CompletionSettings:
    """Who says when the policy's work is complete."""

    checker: str = setting("visual", "Who judges whether work is complete.", "NAME")
    trigger: str = setting("proprioceptive", "When the checker is asked.", "NAME")
    while_asked: Literal["go_on", "hold"] = setting("go_on", "Until the checker answers: go on, or hold still.")


@dataclass(frozen=True, kw_only=True)
class DisturbanceSettings:
    """What goes wrong on purpose, as of `disturbances`."""

    policy_faults: str | None = setting(
        None,
        'Give the policy faults, such as "freeze:p=0.01, jitter:0.02, drift, late:400ms, wrong_object".',
        "FAULTS",
        reader="mpvi_bt.runs.disturbances.faults:read_faults",
        begins=("freeze", "jitter", "drift", "late", "wrong_object"),
    )
    latency: str | None = setting(
        None,
        "Simulated seconds for each answer: policy=0.4,checker=0.5..2,planner=@FILE.",
        "TIMES",
        reader="mpvi_bt.runs.disturbances.latency:read_latencies",
        begins=("policy=", "checker=", "planner="),
    )
    while_inferring: Literal["hold", "go_on"] = setting(
        "hold", "Until a late chunk arrives: hold still, or go on with the previous chunk."
    )


@dataclass(frozen=True, kw_only=True)
class WorldSettings:
    """Robot, simulator, and how grasps hold."""

    robot: str = setting(
        DEFAULT_ROBOT,
        "Robot: one that ships, or one of your own, by name or file.",
        "NAME",
        folder="robots",
    )
    sim: Literal["sapien", "maniskill"] = setting(
        "sapien", "Simulator: the project's own, or its ManiSkill environment."
    )
    assisted: bool = setting(False, "Fix a grasped object to the hand; every report says so.")


@dataclass(frozen=True, kw_only=True)
class TreeSettings:
    """The tree or plan to run instead of the task's own plan.

    Attributes:
        arguments: Names and values of the tree's parameters.
    """

    tree: str | None = setting(None, "Run this tree, by name or file, instead of a plan's.", "NAME", folder="trees")
    plan: str | None = setting(None, "Compile this plan, by name or file.", "NAME", folder="tasks/plans")
    arguments: tuple[tuple[str, str], ...] = ()
    substitute: str | None = setting(None, "Replace nodes by stand-ins, by the rules of this file.", "FILE", folder="")


@dataclass(frozen=True)
class SuiteBudget:
    """How much all episodes of a suite together may ask of language models.

    Attributes:
        ledger: File in which their processes count.
        calls, tokens: At most; None: any number.
    """

    ledger: Path
    calls: int | None = None
    tokens: int | None = None


@dataclass(frozen=True, kw_only=True)
class LanguageSettings:
    """Storage and budget of the language models' answers. Only the answers affect the result.

    Attributes:
        suite_budget: How much the episode's suite may ask, or None.
    """

    exchanges: Path | None = setting(None, "Keep questions and answers of language models, and reuse them.", "DIR")
    offline: bool = setting(False, "Ask no language model; use kept answers only.")
    calls: int | None = setting(None, "At most N questions to language models in an episode.", "N", least=0)
    tokens: int | None = setting(None, "No more questions after N tokens.", "N", least=0)
    suite_budget: SuiteBudget | None = None


@dataclass(frozen=True, kw_only=True)
class OutputSettings:
    """Output files of the episode: films, pictures, logs, traces.

    Attributes:
        trace: File of what happens tick by tick.
        saved: File of how it stands if it is stopped.
        planned: File of the plan that a language model makes; its last answer, where it makes none, goes beside it.
        only_failures: Whether the film is deleted where the goal is met.
    """

    video: Path | None = setting(None, "Film the episode, as mp4.", "FILE")
    picture: Path | None = setting(None, "Draw the robot's path from above, as png.", "FILE")
    rerun: Path | None = setting(None, "Log the episode for the rerun viewer, as rrd.", "FILE")
    mcap: Path | None = setting(None, "Record the episode as ROS 2 messages, as mcap.", "FILE")
    demonstration: Path | None = setting(None, "Record pictures, state and actions there, for `mpvi dataset`.", "DIR")
    demonstration_fps: Literal[1, 2, 3, 5, 6, 10, 15, 30] = setting(10, "Recorded rows and pictures a second.")
    times: Path | None = setting(
        None, "Write the answer times of policy, checker and planner, for --latency PART=@FILE.", "FILE"
    )
    profile: Path | None = setting(None, "Write where the wall time went, as a flame graph for speedscope.", "FILE")
    trace: Path | None = None
    saved: Path | None = None
    planned: Path | None = None
    only_failures: bool = False


@dataclass(frozen=True)
class EpisodeConfig(  # dataclasses take fields from the last base on
    OutputSettings,
    LanguageSettings,
    TreeSettings,
    WorldSettings,
    DisturbanceSettings,
    CompletionSettings,
    PolicySettings,
    PerceptionSettings,
    PlanSettings,
    InstanceSettings,
):
    """One episode, fully named: the same config gives the same result, wall times apart.

    Its fields are those of the groups above. Backends (planner, map, detector, navigator, policy, checker, trigger) are
    given by name, or name and address ("openpi:ws://localhost:8000").
    """

    @property
    def task_name(self) -> str:
        """The task's name, the stem of its file."""
        return Path(self.task).stem if self.task.endswith(paths.SUFFIXES) else self.task

    @property
    def name(self) -> str:
        """The stem of the episode's result file, as BEHAVIOR's evaluator names them, with a named house and hidden."""
        split = "" if self.split == "public" else f"{self.split}_"
        house = "" if self.house is None else f"{self.house_name.replace(':', '-')}_"
        return f"{self.task_name}_{house}{split}{self.instance}_{self.seed}"

    @property
    def house_name(self) -> str:
        """The house that was named in place of the task's own: its name, or the stem of its file; "" for none."""
        house = self.house or ""
        return Path(house).stem if house.endswith(paths.SUFFIXES) else house

    @property
    def backends(self) -> dict[str, str]:
        """Kind to name of every chosen backend."""
        return {kind: getattr(self, kind) for kind in KINDS}

    def kept_in(self, folder: Path, stem: str = "", trace: bool = True) -> EpisodeConfig:
        """The same, its trace, its plan, and how it stands if it is stopped, written there, beside its result.

        Args:
            folder: Of the result, `STEM.json`.
            stem: Of all the files; its `name` by default.
            trace: Whether to write one.
        """
        stem = stem or self.name
        return replace(
            self,
            trace=folder / f"{stem}.trace.jsonl" if trace else None,
            saved=folder / f"{stem}.saved.json",
            planned=folder / f"{stem}.plan.json",
        )

    def record(self) -> dict[str, Any]:
        """Settings to write into the result: all that can change the outcome. Output paths are left out."""
        entries = {
            each.name: getattr(self, each.name)
            for each in fields(self)
            if each.name in RECORDED and (each.name in ALWAYS or getattr(self, each.name) != each.default)
        }
        return entries | ({"arguments": dict(self.arguments)} if self.arguments else {})


KINDS = ("planner", "map", "detector", "navigator", "policy", "checker", "trigger")  # of backends


def names(*groups: type[Any]) -> tuple[str, ...]:
    """The fields of groups of settings."""
    return tuple(each.name for group in groups for each in fields(group))


OUTPUTS = names(OutputSettings)
ASKING = names(LanguageSettings)
METHOD = names(
    PlanSettings, PerceptionSettings, PolicySettings, CompletionSettings, DisturbanceSettings, WorldSettings
)  # what methods set
RECORDED = tuple(name for name in names(EpisodeConfig) if name not in (*OUTPUTS, *ASKING))  # they change the outcome
# Recorded by default too; others only where they are not as by default, so that a new one changes no record of before.
ALWAYS = {
    "task", "instance", "seed", "policy", "detector", "checker", "trigger", "planner", "map", "while_asked", "tree",
    "plan",
}  # fmt: skip
# Of every field that a person sets so; the task, the method and the like have ways of their own.
SETTINGS: Mapping[str, Setting] = {
    each.name: each.metadata["setting"] for each in fields(EpisodeConfig) if each.metadata
}
ONE_EPISODES = ("instance", "seed", *OUTPUTS)  # a suite lists instances and seeds, and has a folder for files
SHARED = tuple(name for name in SETTINGS if name not in ONE_EPISODES)  # the episodes of a suite may have in common
for _group in EpisodeConfig.__bases__:  # docstrings tell of each field what its setting does
    _doc = cleandoc(_group.__doc__ or "")
    _doc += "" if "Attributes:" in _doc else "\n\nAttributes:"
    _lines = [f"\n    {name}: {SETTINGS[name].help}" for name in names(_group) if name in SETTINGS]
    _group.__doc__ = _doc + "".join(_lines)
