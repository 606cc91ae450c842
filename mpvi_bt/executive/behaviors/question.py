"""A question to a slow backend, such as a language model: asked in a thread, answered some ticks later."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Generic, TypeVar

from mpvi_bt.ground.protocols import Clock

T = TypeVar("T")

# Added to what another thread answers: what a busy machine takes to put an answer on file and hand it over after it was
# timed: up to 0.2 s were seen. Without it a live run would now and then get one a step later than the run from file.
HANDOVER_S = 0.5
_SLACK_S = 1e-6  # a step's time is a sum of thirtieths: let rounding not cost a step


class Question(Generic[T]):
    """An answer on its way. The control loop goes on meanwhile; `answer`, called once a tick, never waits a step long.

    The answer takes as much simulated time as its latency says, and `HANDOVER_S`: it is there at the first tick at
    which that has passed since it was asked. So a run with answers on file, each with the latency that was measured
    when it was first given, ticks as the live run did. For this the live run must not be ahead of the wall clock: while
    a question is open, a tick whose simulated time is reached too early waits until it is due, as on a robot (Our
    choice).

    To forget a question is to drop it: its thread ends when `ask` does, and keeps no process from ending.

    Args:
        ask: Asks, and returns the answer. It runs in another thread: whatever it needs of the robot, such as a picture,
            is taken before.
        clock: Simulated time; the question is asked now.
        latency_s: How long the answer took; of one on file, how long it took when it was first given. An `ask` that
            takes longer than this says, by more than `HANDOVER_S`, is late.
        at_once: Ask in this thread and wait. For what is computed here, whose time says nothing; the answer is there in
            the same tick unless `latency_s` makes it later.

    Attributes:
        asked_s: Simulated time at which it was asked.
    """

    def __init__(
        self, ask: Callable[[], T], clock: Clock, latency_s: Callable[[T], float], *, at_once: bool = False
    ) -> None:
        self.asked_s = clock.time_s
        self._clock, self._latency_s = clock, latency_s
        self._handover_s = 0.0 if at_once else HANDOVER_S
        self._asked_wall_s = time.monotonic()
        self._mail: _Mail[T] = _Mail()
        if at_once:
            self._mail.fetch(ask)
        else:
            threading.Thread(target=self._mail.fetch, args=(ask,), name="question", daemon=True).start()

    def answer(self) -> T | None:
        """The answer, or None if it is not due yet.

        Raises:
            Exception: What `ask` raised, as soon as it did.
        """
        elapsed_s = self._clock.time_s - self.asked_s
        ahead_s = elapsed_s - (time.monotonic() - self._asked_wall_s)
        if not self._mail.arrived.wait(max(0.0, ahead_s)):
            return None
        answer = self._mail.opened()
        return answer if self._latency_s(answer) + self._handover_s <= elapsed_s + _SLACK_S else None


class _Mail(Generic[T]):
    """Result of the thread. It has no reference to the question, so that this can be forgotten."""

    def __init__(self) -> None:
        self.arrived = threading.Event()
        self._answers: list[T] = []
        self._error: Exception | None = None

    def fetch(self, ask: Callable[[], T]) -> None:
        try:
            self._answers.append(ask())
        except Exception as error:
            self._error = error
        finally:
            self.arrived.set()

    def opened(self) -> T:
        if self._error is not None:
            raise self._error
        return self._answers[0]
