"""Somebody elsewhere who has a robot: a kinematic one, and what its driver sends in each dialect."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from websockets.sync.client import ClientConnection

from mpvi_bt.executive.remote.codec import pack, unpack
from mpvi_bt.executive.remote.own_keys import OwnKeys
from mpvi_bt.executive.remote.reading import CHUNK
from mpvi_bt.executive.ticking.loop import Watcher, World
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.limits import travel_action
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.hands.behavior_robot import behavior_layout
from mpvi_bt.hands.behavior_robot.behavior import Behavior
from mpvi_bt.hands.robots.r1pro import R1PRO
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.serving.served import ServedWork, executive_server
from mpvi_bt.testing import KinematicWorld
from tests.serving import client, received, running

DIALECTS = ("behavior-2025", "behavior-2026", "openpi")
# Drives, turns and grips, and looks at nothing: what its prompts name is not known.
TREE = """\
tree: exercise
root:
  sequence: exercise
  memory: true
  children:
    - posture: travel
    - timeout: 2
      child: {manipulate: pick up a cup with the right hand}
"""
GRIP = "mpvi_bt.testing.doubles:GripPolicy"


class Driver:
    """A client with a robot.

    Args:
        connection: To the server; the metadata are received here.
        dialect: What it speaks.

    Attributes:
        world: The robot's.
        metadata: What the server said first.
        told: The answers.
    """

    def __init__(self, connection: ClientConnection, dialect: str, batched: bool = False) -> None:
        self.connection, self.dialect, self.batched = connection, dialect, batched
        self.metadata = received(connection)
        self.told: list[Any] = []
        self.begin()

    def begin(self) -> None:
        """Put the robot where it starts."""
        self.world = KinematicWorld()
        self._carry_out(travel_action(R1PRO))

    def reset(self) -> None:
        """Say that an episode begins."""
        self.connection.send(pack({"reset": True}))

    def message(self, **more: Any) -> dict[str, Any]:
        """The present observation; entries that are given beside override it, None leaves one out."""
        robot = self.world.robot
        body = replace(robot.proprioception(), robot="r1pro")
        images = {name: _picture(name) for name in ("head", "left", "right")}
        if self.dialect == "openpi":
            seen = {"prompt": "", "proprioception": body, "images": images}
            message = OwnKeys().write(seen, robot.action, {})
        else:
            dialect = Behavior("behavior-2025" if self.dialect == "behavior-2025" else "behavior-2026")
            message = dialect.write(
                body,
                images,
                R1PRO.camera_poses(body.torso, body.arm),
                1,
                batched=self.batched,
                labels=True,
                vocabulary={},
            )
        return {key: value for key, value in {**message, **more}.items() if value is not None}

    def ask(self, **more: Any) -> Any:
        """One round trip: the answer, or the text of an error frame."""
        self.connection.send(pack(self.message(**more)))
        answer = self.connection.recv(timeout=30)
        self.told.append(answer if isinstance(answer, str) else unpack(answer))
        return self.told[-1]

    def step(self, **more: Any) -> Array:
        """(K, 23) what the answer tells the robot, in our units; it does so."""
        answer = self.ask(**more)
        assert isinstance(answer, dict), answer
        if self.dialect == "openpi":
            actions = np.array(answer["actions"])
        else:
            rows = np.reshape(answer["action_chunk" if CHUNK in more else "action"], (-1, 23))
            actions = behavior_layout.action_from(rows)
        for action in actions:
            self._carry_out(action)
        return actions

    def _carry_out(self, action: Array) -> None:
        self.world.robot.act(action)
        self.world.robot.act(action)
        self.world.step()


def _picture(camera: str, size: int = 8) -> CameraImage:
    """Of a wall 1 m away."""
    rgb, depth, labels = np.zeros((size, size, 3), np.uint8), np.ones((size, size), np.float32), np.zeros((size, size))
    K = np.array([[size, 0, size / 2], [0, size, size / 2], [0, 0, 1]], float)
    return CameraImage(camera, rgb, depth, labels.astype(np.int32), {}, K, np.eye(4))


def observation_2026(size: int) -> dict[str, Any]:
    """What BEHAVIOR's evaluator of 2026 sends of a robot that stands where episodes begin, with labels beside."""
    world = KinematicWorld()
    world.robot.act(travel_action(R1PRO))
    world.step()
    body = replace(world.robot.proprioception(), robot="r1pro")
    images = {name: _picture(name, size) for name in ("head", "left", "right")}
    return Behavior("behavior-2026").write(
        body, images, R1PRO.camera_poses(body.torso, body.arm), 1, batched=True, labels=True, vocabulary={}
    )


@contextmanager
def driving(
    dialect: str, folder: Path, batched: bool = False, said: list[str] | None = None, **config: Any
) -> Iterator[Driver]:
    """A client of an executive that runs `TREE`, or what is given."""
    tree = folder / "exercise.yaml"
    tree.write_text(TREE)
    given = {"tree": str(tree), "policy": GRIP, "map": "online", "robot": "r1pro", **config}
    work = ServedWork(EpisodeConfig(given.pop("task", ""), **given), out=folder / "runs")
    say = (said if said is not None else []).append
    with running(executive_server(dialect, work, say=say)) as server, client(server) as connection:
        yield Driver(connection, dialect, batched)


class Acts(Watcher):
    """Keeps the first actions of an episode that is played here, and then ends it; all of them without `most`.

    Attributes:
        actions: Those, (23,) each.
    """

    def __init__(self, most: int | None = None) -> None:
        self.actions: list[Array] = []
        self._most = most

    def step(self, tree: Tree, world: World) -> None:
        if len(self.actions) == self._most:
            raise KeyboardInterrupt
        self.actions.append(world.robot.action)


class Ear:
    """Hears how an evaluation goes.

    Attributes:
        actions: That were carried out, (23,) each.
    """

    def __init__(self) -> None:
        self.actions: list[Array] = []

    def said(self, line: str) -> None:
        pass

    def stepped(self, instance: int, step: int, most: int) -> None:
        pass

    def acted(self, instance: int, action: Array) -> None:
        self.actions.append(action)
