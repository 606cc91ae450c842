"""One trial: a small scene, a prompt, and what the simulator has to say for it to count; and how a policy plays it."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Policy
from mpvi_bt.ground.robot.model import RobotModel
from mpvi_bt.ground.robot.protocol import Robot, Side
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.house.layout.house import House
from mpvi_bt.house.sim.world import Placement, SimWorld
from mpvi_bt.testing.full_hands import fill, put_in_hands
from tests.layouts import ACTION_SIZE, BASE

Shapes = Literal["tuning", "held_out"]

_EVERY_STEPS = 5  # the truth is asked six times a second
_STEADY_S = 0.5  # success has to last so long
_AFTER_S = 5.0  # and then to survive what the policy still does, up to its "done" or for so long
_SAID_DONE_S = 2.5  # a policy that says "done" too early is believed to mean it after so long
_IDLE_S = 8.0  # a policy that commands nothing new for so long has given up


@dataclass(frozen=True, eq=False)
class Trial:
    """A scene for one skill.

    Attributes:
        house: Rooms and fixtures.
        objects: Movable things by name.
        base: (3,) where the robot starts: x, y [m], yaw [rad], within the handoff distance of what it is to work on.
        prompt: What the policy is told, a full sentence as in a plan.
        done: By simulator truth: "" once the skill has succeeded, else what is missing, a stable code. May be asked at
            any step, only ever of this trial's world.
        budget_s: Simulated time that the policy has.
        held: Things that the hands hold at the start, gripped by friction; where `objects` has them does not matter.
        filled: What lies in things at the start: vessel -> names; dropped in after the hands have closed.
        opened: How far doors and drawers stand open at the start, 0 to 1: fixture -> body -> fraction.
    """

    house: House
    objects: Mapping[str, Placement]
    base: Array
    prompt: str
    done: Callable[[SimWorld], str]
    budget_s: float = 90.0
    held: Mapping[Side, str] = field(default_factory=dict)
    filled: Mapping[str, Sequence[str]] = field(default_factory=dict)
    opened: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def world(self, render: bool, assisted: bool = False, robot: RobotModel = R1) -> SimWorld:
        """The scene, settled, with the hands full where they have to be.

        Raises:
            BackendError: A thing does not fit into the hand that is to hold it.
            NoRenderingDevice: `render` was asked for on a machine that cannot.
        """
        world = SimWorld(self.house, self.objects, self.base, render=render, assisted=assisted, robot=robot)
        for fixture, bodies in self.opened.items():
            for body, fraction in bodies.items():
                world.set_opening(fixture, body, fraction)
        put_in_hands(world, self.held)
        fill(world, self.filled)
        world.settle()
        return world


Scene = Callable[[np.random.Generator, Shapes], Trial]  # draws one trial of a case


@dataclass(frozen=True)
class Played:
    """What came of a trial.

    Attributes:
        missing: What the truth still lacked at the end; "" is success.
        note: What the policy said last.
        simulated_s: Until success began, or all that was played.
        steps: Control steps played.
        wall_s, cpu_s: Of playing, rendering included, building the scene not.
    """

    missing: str
    note: str
    simulated_s: float
    steps: int
    wall_s: float
    cpu_s: float


def play(
    trial: Trial, world: SimWorld, policy: Policy, robot: Robot, watching: Sequence[Callable[[], None]] = ()
) -> Played:
    """Play a trial in a bare loop: an observation, a chunk of actions, the steps of the chunk.

    Args:
        trial: What is to be done.
        world: Its world, from `Trial.world`.
        policy: Who does it.
        robot: Whose senses the policy has: `world.robot`, or a robot of noisy senses around it.
        watching: Called after every step.
    """
    wall, cpu = time.perf_counter(), time.process_time()
    judge = _Judge(trial, world, policy)
    policy.reset()
    while not judge.over:
        images = {camera: robot.look(camera) for camera in policy.cameras}
        observation = {"prompt": trial.prompt, "proprioception": robot.proprioception(), "images": images}
        for action in policy.infer(observation):
            world.robot.act(action)
            world.step()
            for watch in watching:
                watch()
            if judge.step(action):
                break
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    return Played(judge.missing, judge.note, judge.simulated_s, world.steps, wall, cpu)


class _Judge:
    """Says when a trial is over, and what came of it."""

    def __init__(self, trial: Trial, world: SimWorld, policy: Policy) -> None:
        self.trial, self.world, self.policy = trial, world, policy
        self.missing = trial.done(world)
        self.since: float | None = None  # when success began
        self.said: float | None = None  # when the policy began to say that it was done
        self.last, self.moved = np.zeros(ACTION_SIZE), 0.0
        self.over = False

    @property
    def note(self) -> str:
        """What the policy says, if it says anything."""
        return str(getattr(self.policy, "note", ""))

    @property
    def simulated_s(self) -> float:
        """Until success began, or all that was played."""
        return self.world.time_s if self.missing or self.since is None else self.since

    def step(self, action: Array) -> bool:
        """Take note of a step; returns whether the trial is over."""
        now = self.world.time_s
        if np.abs(action - self.last).max() > 1e-6 or np.abs(action[BASE]).max() > 1e-6:
            self.last, self.moved = np.array(action, float), now
        self.said = (now if self.said is None else self.said) if self.note == "done" else None
        phase = self.world.steps % _EVERY_STEPS
        if phase == _EVERY_STEPS - 1:
            self.world.wake()  # so that contacts of what sleeps are reported, too
        if phase == 0:
            self.missing = self.trial.done(self.world)
            self.since = None if self.missing else now if self.since is None else self.since
            held_s = -1.0 if self.since is None else now - self.since
            self.over = (
                now >= self.trial.budget_s
                or (held_s >= _STEADY_S and (self.said is not None or held_s >= _STEADY_S + _AFTER_S))
                or (self.missing != "" and self.said is not None and now - self.said >= _SAID_DONE_S)
                or (self.missing != "" and now - self.moved >= _IDLE_S)
            )
            if self.over and not self.missing and held_s < _STEADY_S:
                self.missing = "too_late"
        return self.over
