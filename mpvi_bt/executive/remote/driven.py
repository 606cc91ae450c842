"""The loop, turned inside out: a client's observations are the steps of episodes, whose actions are the answers.

Each episode runs in the client's thread, where its world's `step` answers the last observation and waits for the next
one. Whatever becomes of an episode, observations are answered until the client is gone: after its end, and where it
breaks, the robot stands and keeps its last targets until a reset begins another one.
"""

from __future__ import annotations

import contextlib
import queue
import threading
import time
import traceback
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from mpvi_bt.executive.remote.codec import unpack
from mpvi_bt.executive.remote.connection import one_line
from mpvi_bt.executive.remote.reading import RESET, Dialect, Reading
from mpvi_bt.executive.remote.remote_world import RemoteWorld
from mpvi_bt.executive.remote.server import Given, Promise, Refused
from mpvi_bt.ground.errors import BadMessage, MpviError, UserError, shown
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.robot_description import RobotDescription

# Plays an episode that begins with an observation, in its world; what became of it, in a line.
Play = Callable[[Reading, RemoteWorld], str]


class Over(KeyboardInterrupt):
    """The episode is to end as by Ctrl-C: a reset came, or the client has gone."""


class DrivenSession:
    """One client's episodes.

    Args:
        dialect: What the client speaks.
        robot: That it has.
        play: Plays an episode.
        say: Told what a person should know, in one line.
    """

    def __init__(self, dialect: Dialect, robot: RobotDescription, play: Play, say: Callable[[str], None]) -> None:
        self._dialect, self._robot, self._play, self._say = dialect, robot, play, say
        self._frames: queue.SimpleQueue[tuple[Given, Promise] | None] = queue.SimpleQueue()
        self._asked: Mapping[str, Any] = {}  # the observation that is open,
        self._broken: BadMessage | None = None  # and why it is none
        self._sent = np.zeros(robot.layout.size)  # the last command
        self._promise: Promise | None = None
        self._began = 0.0
        self._gone = False
        self._thread = threading.Thread(target=self._work, name="executive", daemon=True)
        self._thread.start()

    # --- in the server's thread

    def begin(self) -> Any:
        """At once: what the metadata say of it."""
        promise = Promise()
        layout = self._robot.layout
        rows = {"action_size": layout.size, "actions": layout.kind, "rate_hz": layout.rate_hz}
        promise.keep({"protocol": self._dialect.name, "robot": self._robot.name, **rows})
        return promise.future

    def answer(self, given: Given) -> Any:
        """As of `Talk`."""
        promise = Promise()
        self._frames.put((given, promise))
        return promise.future

    def end(self) -> None:
        """Let the thread end: the client is gone."""
        self._frames.put(None)

    def is_at_work(self) -> bool:
        """Whether the thread has not ended yet."""
        return self._thread.is_alive()

    # --- in its own

    def exchange(self, actions: Array) -> Reading:
        """Answer the open observation, and wait for the next one. Raises Over, BadMessage."""
        before, self._sent = self._sent, actions[-1]
        self._reply(self._dialect.answer(actions, self._asked, self._robot, before))
        self._next()
        return self._read()

    def look(self, camera: str) -> Reading:
        """Ask for the open observation again, with a camera's picture. Raises Over, BadMessage."""
        self._reply({"look": [camera]})
        self._next()
        return self._read()

    def _work(self) -> None:
        with contextlib.suppress(Over):
            self._next()
        while not self._gone:
            self._episode()

    def _episode(self) -> None:
        """All from an observation to the next reset."""
        world: RemoteWorld | None = None
        try:
            try:
                first = self._read()
                world = RemoteWorld(self._robot, first, self)
                self._sent = world.robot.action
                said = self._play(first, world)
            except BadMessage as error:
                if world is None:
                    self._refuse("bad_message", str(error))
                    return
                said = f"bad_message: {error}"
            except UserError as error:
                self._refuse("bad_message", str(error))
                return
            except MpviError as error:
                said = str(error)
            except Exception as error:  # a fault of ours, which must not keep the next episode from being played
                self._say(traceback.format_exc().strip())
                said = f"{type(error).__name__}: {error}"
            said = one_line(said)
            self._say(said)
            while True:
                self._hold(world, said)
                self._next()
        except Over:
            return

    def _hold(self, world: RemoteWorld | None, why: str) -> None:
        """Answer the open observation: the base stands, every joint keeps its target."""
        assert world is not None
        action = world.robot.action
        self._robot.layout.set_velocity(action, 0.0)
        try:
            count = self._read().steps
        except BadMessage:
            count = 1
        told = self._dialect.answer(np.tile(action, (count, 1)), self._asked, self._robot, self._sent)
        self._reply({**told, "ended": why})

    def _refuse(self, kind: str, why: str) -> None:
        """Answer the open observation by an error, which ends the connection; wait until the client has gone."""
        assert self._promise is not None
        self._promise.fail(Refused(kind, why))
        while self._frames.get() is not None:
            pass
        self._gone = True

    def _reply(self, message: dict[str, Any]) -> None:
        assert self._promise is not None
        self._promise.keep((message, time.perf_counter() - self._began))
        self._promise = None

    def _next(self) -> None:
        """Wait for the next observation, and open it. Raises Over where it belongs to another episode, or none comes.

        Raises:
            Over: A reset came before it or with it; or the client is gone.
        """
        anew = False
        while True:
            got = self._frames.get()
            if got is None:
                self._gone = True
                raise Over
            given, self._promise = got
            self._began = time.perf_counter()
            try:
                self._asked = _message(given)
            except BadMessage as error:
                self._asked, self._broken = {}, error
            else:
                self._broken = None
            reset = self._asked.get(RESET, False)
            anew = anew or reset is True
            if reset is True and len(self._asked) == 1:  # it gets no answer
                self._promise.keep((None, 0.0))
                continue
            if anew:
                raise Over
            return

    def _read(self) -> Reading:
        """What the open observation says. Raises BadMessage."""
        if self._broken is not None:
            raise self._broken
        return self._dialect.read(self._asked, self._robot)


def _message(given: Given) -> Mapping[str, Any]:
    """An unpacked frame. Raises BadMessage."""
    if isinstance(given, str):
        raise BadMessage("a text frame; an observation is a binary frame of msgpack")
    message = unpack(given) if isinstance(given, bytes) else given
    if not isinstance(message, Mapping):
        raise BadMessage(f"the observation: {shown(message)} is given, a mapping is wanted")
    return message
