"""A thread that halts the robot when its states are old or wrong, another node commands it, or a signal comes."""

from __future__ import annotations

import os
import select
import signal
import threading
import time
from types import FrameType, TracebackType
from typing import Any

from mpvi_bt.executive.ticking.stop import Stop
from mpvi_bt.runs.ros2.motion_gate import MotionGate
from mpvi_bt.runs.ros2.ros_node import RobotNode

_EVERY_S = 0.02
_STARVED_S = 0.1  # Our choice: a round that takes longer was kept waiting by other threads,
_STARVED_ROUNDS = 2  # and so many of them in a row judge nothing
_LOOK_ROUND_S = 0.25  # how often other nodes are looked for
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
STOPPED = "stopped"  # the reason of a halt by a signal, or by the end


class Watchdog:
    """Watches a bridge; as a context manager, with Ctrl-C and SIGTERM taken over.

    A signal halts the robot in this thread, whatever the main one is at; then the run is asked to end. A second one
    raises KeyboardInterrupt.

    Attributes:
        stalls: How often the loop took so long that the base was stopped meanwhile.
    """

    def __init__(self, node: RobotNode, gate: MotionGate, watchdog_s: float, lockstep: bool, stop: Stop) -> None:
        """Watch a node's states for a gate."""
        self._node, self._gate, self._stop = node, gate, stop
        self._watchdog_s, self._lockstep = watchdog_s, lockstep
        self._over = threading.Event()
        self._pipe = os.pipe()
        self._reading = threading.Lock()
        self._before: dict[int, Any] = {}
        self._thread = threading.Thread(target=self._watch, name="watchdog", daemon=True)
        self.stalls = 0

    def __enter__(self) -> Watchdog:
        """Begin."""
        if threading.current_thread() is threading.main_thread():
            for end in self._pipe:
                os.set_blocking(end, False)
            self._before = {number: signal.signal(number, self._ask) for number in _SIGNALS}
            self._wakeup = signal.set_wakeup_fd(self._pipe[1], warn_on_full_buffer=False)
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Halt the robot, and end."""
        self._gate.halt(STOPPED, "the run has ended" if error is None else f"the run broke: {error}")
        self._over.set()
        self._thread.join()
        if self._before:
            signal.set_wakeup_fd(self._wakeup)
            for number, before in self._before.items():
                signal.signal(number, before)
        for end in self._pipe:
            os.close(end)

    def heed(self) -> None:
        """Halt the robot if a signal has come; the watchdog's own thread may not have had its turn yet."""
        with self._reading:
            if select.select([self._pipe[0]], [], [], 0.0)[0]:
                number = os.read(self._pipe[0], 64)[-1]
                self._gate.halt(STOPPED, f"the process was stopped by {signal.Signals(number).name}")

    def _ask(self, number: int, frame: FrameType | None) -> None:
        if self._stop.requested:
            raise KeyboardInterrupt
        self._stop.request()

    def _watch(self) -> None:
        try:
            self._rounds()
        except Exception as error:
            self._gate.halt("broken", f"the watchdog broke: {type(error).__name__}: {error}")

    def _rounds(self) -> None:
        looked, starved = 0.0, 0
        while not self._over.is_set():
            began = time.monotonic()
            signaled, _, _ = select.select([self._pipe[0]], [], [], _EVERY_S)
            if signaled:
                self.heed()
            starved = starved + 1 if time.monotonic() - began > _STARVED_S else 0
            if 0 < starved <= _STARVED_ROUNDS:
                continue  # the thread that listens was kept from its work as this one was: what is old may be read next
            with self._node.heard.changed:
                wrong = self._node.heard.wrong()
            if wrong is not None:
                self._gate.halt(*wrong)
            if not self._lockstep and self._gate.stand(self._watchdog_s):
                self.stalls += 1
            if self._gate.watched and time.monotonic() - looked > _LOOK_ROUND_S:
                looked = time.monotonic()
                if others := self._node.commanders():
                    self._gate.halt("second_bridge", f"another node commands the robot: {', '.join(others)}")
