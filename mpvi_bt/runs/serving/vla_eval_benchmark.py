"""The tasks as a benchmark of the vla-eval package: `vla-eval run` drives our episodes with its own model servers.

An episode is the very one that `mpvi run` plays, in a thread of its own; its policy is asked over vla-eval's
connection. docs/vla_eval.md tells how it is used. Imported by the name that vla-eval's configs have for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from math import ceil
from pathlib import Path
from typing import Any, ClassVar

from vla_eval.benchmarks.base import StepBenchmark, StepResult
from vla_eval.specs import IMAGE_RGB, LANGUAGE, RAW, DimSpec

from mpvi_bt.executive.remote.dialect_settings import DialectSettings, load_settings
from mpvi_bt.executive.remote.relay import Relay
from mpvi_bt.executive.remote.task_settings import unfit
from mpvi_bt.executive.remote.vla_eval import DEFAULT
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import BackendError, UnknownName, UserError
from mpvi_bt.ground.robot.default_robot import DEFAULT_ROBOT
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.ground.robot.robot_description import RobotDescription
from mpvi_bt.ground.robot.robots import ROBOTS, robot_named
from mpvi_bt.house.instances.tasks import Task, load_task
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.methods import load_method
from mpvi_bt.runs.choices.policies import PolicyInputs, settings_for

POLICY = "vla_eval:runner"  # what results call a policy that is asked over the runner's connection
_HOLD = {"hold": True}  # in the place of an answer that has not come yet
_ICD = "MPVI_LAVAPIPE_ICD"  # environment variable: where Mesa's renderer is, if vla-eval does not find it


def action_spec(settings: DialectSettings, robot: RobotDescription) -> dict[str, DimSpec]:
    """The action space: our numbers in our units, or a robot's joints if settings map them."""
    layout = robot.layout
    if settings.action.parts or settings.action.dialect:
        size = settings.action.told_size or layout.size
        return {"joints": DimSpec("joints", size, f"joint_positions_{robot.name}", description=settings.about)}

    def targets(name: str, where: slice) -> DimSpec:
        numbers = range(layout.size)[where]
        units = ", ".join("m" if i in robot.linear_joints else "rad" for i in numbers)
        return DimSpec(name, len(numbers), "joint_positions", description=f"targets: {units}")

    axes = [axis for axis, at in zip(("x", "y", "yaw"), layout.base, strict=True) if at is not None]
    units = ", ".join("rad/s" if axis == "yaw" else "m/s" for axis in axes)
    kind = "velocity_" + "".join(axes[:-1]) + "_yaw"
    parts = {"base": DimSpec("base", len(axes), kind, description=f"{units} in the base's frame")}
    parts["torso"] = targets("torso", layout.torso)
    for side in robot.sides:
        parts[f"{side}_arm"] = targets(f"{side}_arm", layout.arm[side])
        parts[f"{side}_gripper"] = DimSpec(f"{side}_gripper", 1, "open_positive", (-1, 1))
    return parts


def observation_spec(settings: DialectSettings) -> dict[str, DimSpec]:
    """The observation space; a single named entry for the whole observation."""
    layout = settings.observation
    if layout is None:
        return {
            "observation": DimSpec("observation", 0, "mpvi_bt_whole", description="docs/serving_policies.md of mpvi_bt")
        }
    spec = {key.rpartition(".")[2]: IMAGE_RGB for key in layout.images}
    return spec | ({"state": RAW} if layout.state else {}) | ({"language": LANGUAGE} if layout.prompt else {})


def _are(given: Any, kind: type) -> bool:
    """Whether that is a list of things of a kind, with something in it."""
    return isinstance(given, list | tuple) and bool(given) and all(type(item) is kind for item in given)


class MpviBenchmark(StepBenchmark):  # type: ignore[misc]  # vla_eval is untyped
    """Long-horizon tasks of a household, in physics on a CPU.

    Episode i of a task is its instance i, or the i-th of those that are given; after the last the first comes again. A
    chunk of actions is carried out whole before the next observation. An episode ends when its time is over, or when
    its tree ends.

    Args:
        tasks: Names of tasks, or their files; None: all that there are.
        instances: Which of their starts; None: all.
        method: Name or file of who plans, drives and judges; by default the policy alone does everything. The policy of
            a method is left out: it is the model server.
        policy_settings: Name or file of what an observation has in it and how actions are read.
        cameras: Those whose pictures observations have until an answer names others; None:
            all that the settings map.
        seed: Of what is random beside the model server.
        out: Folder for results and traces, as of `mpvi run --out`; None: none are written.

    Raises:
        UserError: Something of this does not exist.
        FileProblems: Everything that is wrong with one of the files.
    """

    render_backends: ClassVar[frozenset[str]] = frozenset({"gpu", "cpu"})
    _ALL_RECORD_FIELDS = frozenset({"note"})

    def __init__(
        self,
        tasks: Sequence[str] | None = None,
        instances: Sequence[int] | None = None,
        method: str = "e2e",
        policy_settings: str = DEFAULT,
        cameras: Sequence[str] | None = None,
        seed: int = 0,
        out: str | None = None,
    ) -> None:
        super().__init__()
        for given, kind, like in ((tasks, str, "tasks: [picking_up_trash]"), (instances, int, "instances: [0, 1]")):
            if given is not None and not _are(given, kind):
                raise UserError(f"{given!r} is given where a list is wanted, such as {like}.")
        chosen = paths.names("tasks") if tasks is None else tasks
        self._tasks = {EpisodeConfig(name).task_name: (name, load_task(name)) for name in chosen}
        self._instances = instances
        for _, task in self._tasks.values():
            for instance in instances or ():
                task.check_instance(instance)
        self._settings = load_settings(policy_settings)
        if wrong := next((camera for camera in cameras or () if camera not in self._settings.known_cameras), None):
            raise UnknownName("camera", str(wrong), self._settings.known_cameras)
        self._cameras = cameras
        asked = {"policy": POLICY, "policy_settings": policy_settings}
        self._common = {**load_method(method), **asked, "seed": seed}
        fitting = [name for name, robot in ROBOTS.items() if not unfit(self._settings, robot)]
        if "robot" not in self._common and fitting and EpisodeConfig.robot not in fitting:
            self._common["robot"] = fitting[0]
        self._out = Path(out) if out is not None else None
        # Our choice: one for all episodes, as everything of the renderer then happens in one.
        self._thread = ThreadPoolExecutor(1, "episode")
        self._playing: tuple[Relay, Future[dict[str, Any]]] | None = None

    @classmethod
    def configure_render(cls, mode: str) -> dict[str, str]:
        """Have SAPIEN draw on the CPU, or on what it chooses itself ("gpu"), before it is loaded."""
        from vla_eval.render import configure_sapien_render

        env: dict[str, str] = configure_sapien_render(mode, _ICD)
        return env

    # --- what there is

    def get_tasks(self) -> list[dict[str, Any]]:
        """Every task, by its name."""
        return [
            {"name": name, "suite": "mpvi_bt", "instruction": task.instruction}
            for name, (_, task) in self._tasks.items()
        ]

    def get_metadata(self) -> dict[str, Any]:
        """How many observations an episode has at most, and how many different episodes every task has."""
        tasks = [task for _, task in self._tasks.values()]
        return {
            "max_steps": ceil(max(task.budget_s for task in tasks) * CONTROL_HZ) + 1,
            "max_episodes_per_task": min(len(self._starts(task)) for task in tasks),
            "control_hz": CONTROL_HZ,
        }

    def get_action_spec(self) -> dict[str, DimSpec]:
        """As of `action_spec`."""
        return action_spec(self._settings, robot_named(self._common.get("robot", DEFAULT_ROBOT)))

    def get_observation_spec(self) -> dict[str, DimSpec]:
        """As of `observation_spec`."""
        return observation_spec(self._settings)

    def get_metric_keys(self) -> dict[str, str]:
        """The figures whose means are told."""
        return dict.fromkeys(("success", "q", "goal_fraction", "conditions_met", "simulated_s"), "mean")

    def get_hold_action(self, last_action: dict[str, Any] | None) -> dict[str, Any]:
        """The action while the model server thinks (live mode): stand still."""
        return _HOLD

    # --- an episode

    def reset(self, task: dict[str, Any]) -> dict[str, Any]:
        """Begin an episode; its first observation.

        Raises:
            MpviError: It cannot be played.
            BackendError: It is over before the policy is asked anything.
        """
        self._stop()
        given, known = self._tasks[task["name"]]
        starts = self._starts(known)
        config = EpisodeConfig(given, starts[int(task.get("episode_idx", 0)) % len(starts)], **self._common)
        if self._out is not None:
            config = replace(config, trace=self._out / f"{config.name}.trace.jsonl")
        settings = settings_for(self._common["policy_settings"], known.problem, config.robot)
        relay = Relay(POLICY, settings, self._cameras)
        playing = self._thread.submit(self._play, config, relay)
        self._playing = relay, playing
        first = relay.asked()
        if first is None:
            playing.result()
            raise BackendError(f"{config.name}: the episode is over before the policy is asked anything")
        self._recorder.record_video(relay.seen)
        return first

    def step(self, action: dict[str, Any]) -> StepResult:
        """Carry out an answer of the model server, or stand for a step. Raises PolicyError if it is none."""
        assert self._playing is not None
        relay, _ = self._playing
        if action is _HOLD:
            relay.hold()
        else:
            relay.answer(action)
        self._recorder.record_step(note=relay.note)
        following = relay.asked()
        if following is not None:
            self._recorder.record_video(relay.seen)
        return StepResult(obs=following, reward=0.0, done=following is None, info={})

    def make_obs(self, raw_obs: dict[str, Any], task: dict[str, Any]) -> dict[str, Any]:
        """The message, as it is."""
        return raw_obs

    def get_step_result(self, step_result: StepResult) -> dict[str, Any]:
        """The episode's figures, each condition of its goal among them. It ends here, if it has not yet.

        Raises:
            MpviError: It broke.
        """
        assert self._playing is not None
        relay, playing = self._playing
        relay.stop()
        result = playing.result()
        if result["ended"] == "backend_error":
            why = result["failures"][-1]
            raise BackendError(f"{why['reason']}: {why['feedback']}")
        return {
            "success": result["success"],
            "q": result["q_score"]["final"],
            "goal_fraction": result["goal_fraction"],
            "conditions_met": result["conditions_met"],
            "conditions": {condition["condition"]: condition["satisfied"] for condition in result["goal"]},
            "simulated_s": result["time"]["simulator_time"],
            "control_steps": result["steps"],
            "ended": result["ended"],
        }

    def cleanup(self) -> None:
        """End what is still being played."""
        self._stop()
        self._thread.shutdown()

    def _starts(self, task: Task) -> Sequence[int]:
        """The instances that its episodes begin with, in order."""
        return range(task.instances) if self._instances is None else self._instances

    def _stop(self) -> None:
        """End an episode that nobody waits for any more."""
        if self._playing is not None:
            relay, playing = self._playing
            relay.stop()
            playing.exception()
            self._playing = None

    def _play(self, config: EpisodeConfig, relay: Relay) -> dict[str, Any]:
        """The episode, from its beginning to its result."""
        from mpvi_bt.runs.episode.episode import run  # loads the simulator, which the choice of a renderer comes before
        from mpvi_bt.runs.episode.result import write_result

        def make(ground: PolicyInputs) -> Relay:
            relay.vocabulary = ground.vocabulary
            return relay

        try:
            result = run(config, make=make)
            if self._out is not None:
                write_result(self._out / f"{config.name}.json", result)
            return result
        finally:
            relay.over()
