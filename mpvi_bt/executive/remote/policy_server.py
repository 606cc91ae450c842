"""A policy behind the server: each client has one of its own, in a thread of its own."""

from __future__ import annotations

import asyncio
import contextlib
import queue
import threading
import traceback
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from mpvi_bt.executive.remote.codec import unpack
from mpvi_bt.executive.remote.observation import Vocabulary, read_observation
from mpvi_bt.executive.remote.server import Given, Promise, Refused, SocketServer, Unseen
from mpvi_bt.ground.compiled import compiling
from mpvi_bt.ground.errors import BadMessage
from mpvi_bt.ground.protocols import Policy
from mpvi_bt.ground.robot.default_robot import DEFAULT_ROBOT
from mpvi_bt.ground.robot.robots import layout_of, robot_named

Make = Callable[[Vocabulary], Policy]


class PolicyServer(SocketServer):
    """Serves a policy.

    Args:
        name: Of the policy, for the metadata.
        make: Makes one, with what labels of pictures are called, whose rows come at the `rate_hz` of an observation
            that says one; for each client, in the client's thread, and anew when
            the client says what its labels are called.
        api_key, say, idle_s: As of `SocketServer`.
    """

    def __init__(
        self,
        name: str,
        make: Make,
        api_key: str = "",
        say: Callable[[str], None] = lambda line: None,
        idle_s: float | None = None,
    ) -> None:
        super().__init__(name, lambda: Session(make), api_key, say, idle_s)


class Session:
    """The policy of one client, in a thread of its own.

    The thread is a daemon: a policy that hangs must not keep the server from ending.

    Args:
        make: Makes the policy.
    """

    def __init__(self, make: Make) -> None:
        self._make = make
        self._policy: Policy | None = None
        self._vocabulary: Vocabulary = {}
        self._prompt: str | None = None
        self._calls: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="policy", daemon=True)
        self._thread.start()

    def begin(self) -> asyncio.Future[dict[str, Any]]:
        """Make the policy; `cameras`, those that it wants first. The future raises Refused."""
        return self._later(self._begin)

    def answer(self, given: Given) -> asyncio.Future[tuple[dict[str, Any] | None, float]]:
        """The answer to an observation, and how long the policy took [s]. The future raises Refused."""
        return self._later(lambda: self._answer(given))

    def end(self) -> None:
        """Let the thread end after what it is doing."""
        self._calls.put(None)

    def is_at_work(self) -> bool:
        """Whether the thread has not ended yet, be the client gone or not."""
        return self._thread.is_alive()

    def _later(self, call: Callable[[], Any]) -> asyncio.Future[Any]:
        promise = Promise()

        def run() -> None:
            try:
                promise.keep(call())
            except Refused as refused:
                promise.fail(refused)
            except Exception:  # whatever a policy may raise is its client's to read
                promise.fail(Refused("policy_failed", traceback.format_exc()))

        self._calls.put(run)
        return promise.future

    def _work(self) -> None:
        while (call := self._calls.get()) is not None:
            call()
        self._close()

    def _close(self) -> None:
        with contextlib.suppress(Exception):  # its client is gone, or has no more use for it
            getattr(self._policy, "close", lambda: None)()

    def _begin(self) -> dict[str, Any]:
        self._close()
        self._policy = self._make(self._vocabulary)
        self._policy.reset()
        kind = getattr(self._policy, "actions", "absolute")
        size = robot_named(DEFAULT_ROBOT).layout.size  # of an observation that names no robot
        return {"cameras": list(self._policy.cameras), "actions": kind, **self._rate({}), "action_size": size}

    def _rate(self, observation: Mapping[str, Any]) -> dict[str, float]:
        """The rate of the rows of an answer, if anybody says it."""
        rate_hz = observation.get("rate_hz", getattr(self._policy, "rate_hz", None))
        return {} if rate_hz is None else {"rate_hz": float(rate_hz)}

    def _answer(self, given: Given) -> tuple[dict[str, Any], float]:
        try:
            policy, observation = self._asked(given)
        except BadMessage as error:
            raise Refused("bad_message", str(error)) from None
        started = compiling.clock()
        actions = np.asarray(policy.infer(observation), float)
        infer_s = compiling.clock() - started
        size = layout_of(observation["proprioception"]).size
        if actions.ndim != 2 or actions.shape[1] != size or not len(actions) or not np.isfinite(actions).all():
            raise Refused("policy_failed", f"actions of shape {actions.shape}; (H, {size}) and finite is wanted")
        message = {
            "actions": actions,
            "cameras": list(policy.cameras),
            "note": str(getattr(policy, "note", "")),
            "gave_up": bool(getattr(policy, "gave_up", False)),
            "ended": bool(getattr(policy, "ended", False)),
            "policy_timing": {"infer_ms": infer_s * 1000},
            **self._rate(observation),
        }
        if (progress := getattr(policy, "progress", None)) is not None:
            message["progress"] = float(progress)
        return message, infer_s

    def _asked(self, given: Given) -> tuple[Policy, dict[str, Any]]:
        """The policy, ready for an observation, and the observation. Raises BadMessage, Unseen."""
        if isinstance(given, str):
            raise BadMessage("a text frame; an observation is a binary frame of msgpack")
        question = read_observation(unpack(given) if isinstance(given, bytes) else given)
        assert self._policy is not None
        prompt = question.observation["prompt"]
        if question.vocabulary is not None and question.vocabulary != self._vocabulary:
            self._vocabulary = question.vocabulary
            self._begin()
        elif question.reset or prompt != self._prompt:
            self._policy.reset()
        self._prompt = prompt
        for camera in self._policy.cameras:
            if camera not in question.observation["images"]:
                raise Unseen("bad_message", f"images: {camera} is missing, which the last `cameras` asked for")
        rate = {} if question.rate_hz is None else {"rate_hz": question.rate_hz}
        return self._policy, question.observation | rate
