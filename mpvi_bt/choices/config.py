"""What one episode is: light, so that it travels to worker processes and the command line loads it at once."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal

from mpvi_bt import paths

EPISODE = "mpvi_bt.episode.episode:run"  # the function that runs one


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


@dataclass(frozen=True)
class EpisodeConfig:
    """One episode, fully named: the same config gives the same result, wall times apart.

    Attributes:
        task: Name of a task (tasks/*.yaml), or the file of one.
        instance: Which of the task's start states.
        seed: Seed of everything random in the episode; the evaluator's rollout id.
        split: Which instances are meant: the "public" ones, or the "hidden" ones, whose seed is kept secret.
        policy, detector, checker, trigger, planner, map: Backends, by name, or name and address
            ("openpi:ws://localhost:8000").
        method: Name of the method that these choices come from (tasks/methods/*.yaml), or None; the choices themselves
            say what was run.
        drive: Who carries out the navigation segments of a plan: the "navigator", or the "policy", which is told their
            descriptions.
        while_asked: What the robot does while the checker has not answered yet: "go_on" or "hold".
        on_failure: What becomes of a unit of the plan that fails: "advance", "retry:2" or "replan".
        policy_settings: Name or file of how a remote policy is spoken to, or None: its default.
        policy_horizon: How many actions of each chunk are carried out before the policy is asked again; None: all.
        policy_ensemble: Decay of the weights where the policy is asked at every step and what its chunks foresee for a
            step is averaged; None: they are not averaged.
        policy_faults: Faults that the policy is given, as of `disturbances.faults`, or None.
        latency: How long policy, checker and planner take in simulated time, as of `disturbances.latency`; None: as
            long as they say themselves.
        while_inferring: What the robot does while a chunk is late: "hold", or "go_on" with the chunk before.
        unit: Name or file of the tree that each unit of manipulation runs in, such as "intervene", or None: the policy
            works until the checker says that it is complete.
        calibration: File of the monitors' thresholds; None: they only record.
        assisted: Whether a closing hand fixes what it pinches to itself; otherwise grasps hold by friction alone.
        robot: Which robot, by name.
        sim: Whose scene it is run in: "sapien", the core's own, or "maniskill", that of its environment.
        tree: Name or file of a tree to run instead of compiling a plan, or None.
        plan: Name or file of a plan instead of the task's own, or None.
        arguments: Names and values of that tree's parameters.
        substitute: File of rules that put stand-ins in the place of nodes, or None.
        exchanges: Folder of what is asked of language models and answered, which is not asked again; None: none.
        offline: Whether nothing is asked but what is on file there.
        calls, tokens: How much the episode may ask of language models at most; None: any number.
        suite_budget: The same of its suite, or None.
        video, picture, rerun, trace: Where to write the episode's film, its picture from above, its recording for the
            rerun viewer and its trace, or None.
        demonstration: Folder to record it in as a demonstration for LeRobot datasets, or None.
        demonstration_fps: Rows and pictures of that a second; divides 30.
        saved: Where to write how it stands if it is stopped, or None.
        planned: Where to write the plan that a language model makes, or None; its last answer, where it makes none,
            goes beside it.
    """

    task: str
    instance: int = 0
    seed: int = 0
    split: Literal["public", "hidden"] = "public"
    policy: str = "expert"
    detector: str = "segmentation"
    checker: str = "visual"
    trigger: str = "proprioceptive"
    planner: str = "recorded"
    map: str = "prior"
    method: str | None = None
    drive: Literal["navigator", "policy"] = "navigator"
    while_asked: Literal["go_on", "hold"] = "go_on"
    on_failure: str = "advance"
    policy_settings: str | None = None
    policy_horizon: int | None = None
    policy_ensemble: float | None = None
    policy_faults: str | None = None
    latency: str | None = None
    while_inferring: Literal["hold", "go_on"] = "hold"
    unit: str | None = None
    calibration: str | None = None
    assisted: bool = False
    robot: str = "r1"
    sim: Literal["sapien", "maniskill"] = "sapien"
    tree: str | None = None
    plan: str | None = None
    arguments: tuple[tuple[str, str], ...] = ()
    substitute: str | None = None
    exchanges: Path | None = None
    offline: bool = False
    calls: int | None = None
    tokens: int | None = None
    suite_budget: SuiteBudget | None = None
    video: Path | None = None
    picture: Path | None = None
    rerun: Path | None = None
    trace: Path | None = None
    demonstration: Path | None = None
    demonstration_fps: int = 10
    saved: Path | None = None
    planned: Path | None = None

    @property
    def task_name(self) -> str:
        """The task's name, the stem of its file."""
        return Path(self.task).stem if self.task.endswith(paths.SUFFIXES) else self.task

    @property
    def name(self) -> str:
        """The stem of the episode's result file, as BEHAVIOR's evaluator names them; hidden instances say so."""
        split = "" if self.split == "public" else f"{self.split}_"
        return f"{self.task_name}_{split}{self.instance}_{self.seed}"

    @property
    def backends(self) -> dict[str, str]:
        """Kind to name of every chosen backend."""
        return {kind: getattr(self, kind) for kind in ("planner", "map", "detector", "policy", "checker", "trigger")}

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
        """What a result says of it: everything that can change the outcome, so not where pictures go."""
        entries = {key: value for key, value in asdict(self).items() if key not in (*OUTPUTS, *ASKING)}
        entries["arguments"] = dict(self.arguments)
        unused = {field.name for field in fields(self) if getattr(self, field.name) == field.default} & _RARE
        return {key: value for key, value in entries.items() if key not in unused}


# Where what is watched goes.
OUTPUTS = {"video", "picture", "rerun", "trace", "demonstration", "demonstration_fps", "saved", "planned"}
# Of language models what they answer matters, and neither where that is kept nor what it may cost.
ASKING = ("exchanges", "offline", "calls", "tokens", "suite_budget")
# Left out where they are not used.
_RARE = {
    "arguments", "substitute", "on_failure", "policy_settings", "policy_horizon", "policy_ensemble", "assisted",
    "policy_faults", "latency", "while_inferring", "unit", "calibration", "method", "drive", "split", "sim", "robot",
}  # fmt: skip
