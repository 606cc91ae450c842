"""A stand-in for BEHAVIOR's evaluator: a client that drives our house's robot as a policy's server tells it to.

It does what the evaluators of 2025 and 2026 do, in the order in which they do it: the health check, the metadata, the
resets, observations, chunks, time limits, results. docs/evaluator.md says what it was written from, and what it cannot
stand in for.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np

from mpvi_bt.executive.remote.codec import MAX_BYTES, pack
from mpvi_bt.executive.remote.connection import Connection, Lost, health
from mpvi_bt.executive.remote.openpi import url_of
from mpvi_bt.executive.remote.own_keys import OwnKeys
from mpvi_bt.executive.remote.reading import CHUNK, RESET
from mpvi_bt.executive.ticking.goal_report import GoalReport
from mpvi_bt.ground.errors import PolicyError, UserError, shown
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.human import Human, human_stats
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, CameraImage
from mpvi_bt.ground.robot.robots import robot_named
from mpvi_bt.hands.behavior_robot import behavior_layout
from mpvi_bt.hands.behavior_robot.behavior import Behavior
from mpvi_bt.house.goals.evaluate import judge, snapshot
from mpvi_bt.house.goals.predicates import truth_in
from mpvi_bt.house.instances.instances import begin, expanded_problem
from mpvi_bt.house.instances.tasks import Task, load_task
from mpvi_bt.house.layout.house import load_house
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.things.catalogue import load_catalogue
from mpvi_bt.runs.episode.assembly import floors
from mpvi_bt.runs.episode.metrics import Meter, ratio
from mpvi_bt.runs.episode.result import write_json
from mpvi_bt.runs.serving.served import check_robot

DialectName = Literal["behavior-2025", "behavior-2026", "openpi"]
_HEALTH_S, _HEALTH_EVERY_S = 2.0, 5.0
_METADATA_S = 10.0  # 2026; that of 2025 waits for ever
_ANSWER_S = {"behavior-2025": 3600.0, "behavior-2026": 600.0, "openpi": 600.0}  # 2025 waits for ever
_TIMES_HUMAN = {"behavior-2025": 2.0, "behavior-2026": 1.5, "openpi": 2.0}
_RECONNECTS = {"behavior-2025": 0, "behavior-2026": 3, "openpi": 0}
_WALL_S_A_STEP = 1.0  # 2026: of a rollout
_JUDGED_EVERY = 15  # steps. Our choice: theirs judges every step, which takes longer than the physics here


@dataclass(frozen=True)
class Evaluation:
    """What is evaluated.

    Attributes:
        address: Of the server.
        dialect: What it is spoken to in.
        task: Name or file of a task.
        instances: Which of its starts.
        robot: That does it.
        batched: Whether arrays have a leading 1, as since 3.9.3 of 2026; not in the dialect openpi.
        chunk: How many actions are asked for at once, or None: one, without saying so.
        labels: Whether pictures have labels and a vocabulary, which no evaluator sends.
        on_demand: Whether only pictures are sent that the server asks for; evaluators send all.
        assisted: Whether grasps are assisted.
        max_steps: Of a rollout; None: as the evaluator has it, by how long people took.
        wait_s: How long a server that is not there yet is waited for; evaluators wait for ever.
        out: Folder for results; None: none are written.
    """

    address: str
    dialect: DialectName
    task: str
    instances: tuple[int, ...] = (0,)
    robot: str = behavior_layout.BODY
    batched: bool = False
    chunk: int | None = None
    labels: bool = False
    on_demand: bool = False
    assisted: bool = False
    max_steps: int | None = None
    wait_s: float = 60.0
    out: Path | None = None


class EvaluationListener(Protocol):
    """Is told how it goes."""

    def said(self, line: str) -> None:
        """What a person should know."""
        ...

    def stepped(self, instance: int, step: int, most: int) -> None:
        """A control step was carried out."""
        ...

    def acted(self, instance: int, action: Array) -> None:
        """What the robot was told for a step, (A,) in our units."""
        ...


@dataclass(frozen=True)
class Rollout:
    """What became of one instance.

    Attributes:
        task, instance: Which.
        goal: At its end.
        ended: "success", "max_steps" or "wall_limit".
        result: As the evaluator writes it.
    """

    task: str
    instance: int
    goal: GoalReport
    ended: str
    result: Mapping[str, Any]


def evaluate(session: Evaluation, listener: EvaluationListener) -> list[Rollout]:
    """Run every instance over one connection.

    Raises:
        UserError: There is no such task, instance or robot.
        PolicyError: The server is away, says that something is wrong, or answers no action.
        NoRenderingDevice: Nothing can be drawn here.
    """
    task = load_task(session.task)
    for instance in session.instances:
        task.check_instance(instance)
    check_robot(session.dialect, session.robot)
    if session.chunk is not None and session.dialect == "behavior-2025":
        raise UserError("the evaluator of 2025 asks for one action at a time.")
    most = session.max_steps or int(_TIMES_HUMAN[session.dialect] * _human_steps(task))
    server = _Connection(session, listener)
    try:
        if session.dialect == "behavior-2025":
            server.reset()
        return [_rollout(session, task, instance, most, server, listener) for instance in session.instances]
    finally:
        server.close()


def _human_steps(task: Task) -> float:
    human = human_stats().get(task.problem)
    return human.steps if human else task.budget_s * CONTROL_HZ / 2


def _rollout(
    session: Evaluation, task: Task, instance: int, most: int, server: _Connection, listener: EvaluationListener
) -> Rollout:
    house, catalogue = load_house(task.house), load_catalogue()
    problem = expanded_problem(task, house)
    listener.said(f"{session.task}, instance {instance}: setting up")
    if session.dialect == "behavior-2025":
        server.reset()
    robot = robot_named(session.robot)
    world, start = begin(task, house, catalogue, problem, instance, assisted=session.assisted, robot=robot)
    truth = truth_in(world, start.scene_names)
    before = snapshot(problem, truth)
    server.reset()
    vocabulary: dict[str, Iterable[str]] = {e.name: e.phrases for e in world.knowledge() if e.kind != "room"}
    vocabulary.update(world.phrases)
    writer = _Writer(session, task, world, {**vocabulary, **floors(house)})
    meter, began, ended = Meter(), time.monotonic(), "max_steps"
    meter.note(world)
    while world.steps < most:
        if session.dialect == "behavior-2026" and time.monotonic() - began > most * _WALL_S_A_STEP:
            ended = "wall_limit"
            break
        actions = server.actions(writer)
        for action in actions:
            listener.acted(instance, action)
            world.robot.act(action)
            world.step()
            meter.note(world)
            listener.stepped(instance, world.steps, most)
            if world.steps >= most:
                break
        if world.steps % _JUDGED_EVERY < len(actions) and judge(problem, before, snapshot(problem, truth)).satisfied:
            ended = "success"
            break
    world.settle()
    goal = judge(problem, before, snapshot(problem, truth))
    measured = meter.measurement
    result = _result(session, instance, goal, measured, human_stats().get(task.problem))
    if session.out is not None:
        folder = session.out / ("metrics" if session.dialect == "behavior-2025" else "json")
        write_json(folder / f"{Path(session.task).stem}_{instance}_0.json", result)
    listener.said(f"{session.task}, instance {instance}: q {goal.q:.3f} after {world.steps} steps, {ended}")
    return Rollout(session.task, instance, goal, ended, result)


def _result(session: Evaluation, instance: int, goal: GoalReport, measured: Any, human: Human | None) -> dict[str, Any]:
    """A result in the layout of the evaluator's files; null for its figures that JSON lacks, such as inf."""
    distance: dict[str, float] = {"base": measured.base_m} | {str(side): m for side, m in measured.hand_world_m.items()}
    means: dict[str, float] = (
        {"base": human.base_m} | {str(side): m for side, m in human.hand_m.items()} if human else {}
    )
    told: dict[str, Any] = {
        "q_score": {"final": goal.q},
        "agent_distance": distance,
        "normalized_agent_distance": {k: ratio(means[k], distance[k]) if means else None for k in distance},
        "time": {
            "simulator_steps": measured.steps,
            "simulator_time": measured.time_s,
            "normalized_time": ratio(human.steps, measured.steps) if human else None,
        },
    }
    if session.dialect == "behavior-2025":
        return told
    more = {"instance_id": instance, "rollout_id": 0, "steps": measured.steps, "success": goal.satisfied}
    return {"task": Path(session.task).stem, **more, **told}


class _Writer:
    """Makes the observations of a world."""

    def __init__(
        self, session: Evaluation, task: Task, world: SimWorld, vocabulary: Mapping[str, Iterable[str]]
    ) -> None:
        self._session, self._task, self._world = session, task, world
        self._vocabulary: Mapping[str, Iterable[str]] | None = vocabulary
        human = human_stats().get(task.problem)
        self._number = human.task_id if human else None
        self._cameras = () if session.on_demand else tuple(world.robot.model.cameras)
        self._images: dict[str, CameraImage] = {}
        self._step = -1

    @property
    def command(self) -> Array:
        """(A,) what the robot is told now."""
        return self._world.robot.action

    def write(self, more: Iterable[str] = ()) -> dict[str, Any]:
        """The message of the present step, with pictures of `more` cameras."""
        session, robot = self._session, self._world.robot
        if self._step != self._world.steps:
            self._images, self._step = {}, self._world.steps
        for camera in (*self._cameras, *more):
            if camera not in self._images:
                self._images[camera] = robot.look(camera)
        body = robot.proprioception()
        vocabulary, self._vocabulary = (self._vocabulary, None) if session.labels else (None, None)
        if session.dialect == "openpi":
            seen = {"prompt": self._task.instruction, "proprioception": body, "images": self._images}
            message = OwnKeys().write(seen, robot.action, vocabulary)
        else:
            poses = robot.model.camera_poses(body.torso, body.arm)
            message = Behavior(session.dialect).write(
                body, self._images, poses, self._number, batched=session.batched, labels=session.labels,
                vocabulary=vocabulary,
            )  # fmt: skip
        if session.chunk is not None:
            message[CHUNK] = session.chunk
        return message


class _Connection:
    """The connection."""

    def __init__(self, session: Evaluation, listener: EvaluationListener) -> None:
        self._session, self._listener = session, listener
        self._url = url_of(session.address)
        self._left = _RECONNECTS[session.dialect]
        self._robot = robot_named(session.robot)
        self._size = self._robot.layout.size
        _await_health(self._url, session.wait_s)
        self._connection = self._connect()

    def _connect(self) -> Connection:
        return Connection(self._url, time.monotonic() + _METADATA_S, MAX_BYTES)

    def close(self) -> None:
        self._connection.close()

    def reset(self) -> None:
        """Say that an episode begins; there is no answer."""
        self._connection.send(pack({RESET: True}), time.monotonic() + _METADATA_S)

    def actions(self, writer: _Writer) -> Array:
        """(K, A) the answer to the present observation, in our units. Raises PolicyError."""
        more: list[str] = []
        asked = len(self._robot.cameras) + 1  # each answer without an action may ask for one more picture
        for _ in range(asked):
            answer = self._ask(writer.write(more))
            if not isinstance(answer, dict):
                raise PolicyError("bad_reply", f"an answer that is {shown(answer)}, not a mapping")
            if (actions := self._told(answer, writer.command)) is not None:
                return actions
            more += [camera for camera in answer.get("look", ()) if camera in self._robot.cameras]
        raise PolicyError("bad_reply", f"no action in {asked} answers, the last of which has {', '.join(answer)}")

    def _ask(self, message: Mapping[str, Any]) -> Any:
        packed = pack(message)
        while True:
            deadline = time.monotonic() + _ANSWER_S[self._session.dialect]
            try:
                self._connection.send(packed, deadline)
                return self._connection.receive(deadline)
            except Lost as error:
                if not self._left:
                    raise
                self._left -= 1
                self._listener.said(f"{error}; connecting anew")
                self._connection.close()
                self._connection = self._connect()

    def _told(self, answer: Mapping[str, Any], before: Array) -> Array | None:
        if self._session.dialect == "openpi":
            if "actions" not in answer:
                return None
            return OwnKeys().told(_rows(answer["actions"], self._size), self._robot, before)
        if "action" not in answer:
            return None
        first = _rows(np.asarray(answer["action"], np.float32), self._size)[:1]
        if self._session.chunk is None:
            return behavior_layout.action_from(first)
        if "action_chunk" not in answer:
            self._listener.said("no action_chunk in the answer: going on singly")
            return behavior_layout.action_from(first)
        chunk = _rows(np.asarray(answer["action_chunk"], np.float32), self._size)
        if len(chunk) != self._session.chunk or not np.array_equal(chunk[:1], first):
            raise PolicyError(
                "bad_reply",
                f"a chunk of {len(chunk)} that begins otherwise than the action, or is not of {self._session.chunk}",
            )
        return behavior_layout.action_from(chunk)


def _await_health(url: str, wait_s: float) -> None:
    """Ask for /healthz until it is well. Raises PolicyError."""
    deadline = time.monotonic() + wait_s
    while True:
        status = health(url, time.monotonic() + _HEALTH_S)
        if status is not None and status < 400:
            return
        if time.monotonic() >= deadline:
            said = f"/healthz answers {status}" if status else "/healthz is not answered"
            raise PolicyError("server_absent", f"{url}: {said}; is `mpvi serve` running there?")
        time.sleep(min(_HEALTH_EVERY_S, max(deadline - time.monotonic(), 0.0)))


def _rows(given: Any, size: int) -> Array:
    """(K, A) of actions (A,), (K, A) or (1, K, A). Raises PolicyError."""
    actions = np.asarray(given)
    if actions.dtype.kind not in "fiu" or actions.size % size or actions.shape[-1:] != (size,):
        raise PolicyError("bad_reply", f"actions of shape {actions.shape} and dtype {actions.dtype}")
    if not np.isfinite(actions).all():
        raise PolicyError("bad_reply", "actions that are not finite")
    return actions.reshape(-1, size).astype(float)
