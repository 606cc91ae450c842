"""A policy's client that has patience: a lost connection is made anew a few times, what a server refuses is told."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Generic, Protocol, TypeVar

from mpvi_bt.executive.remote.connection import Lost
from mpvi_bt.executive.remote.dialect_settings import DialectSettings
from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import PolicyError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import Proprioception

_PAUSE_S = 0.25  # before a lost connection is made anew
Result = TypeVar("Result")


class Closable(Protocol):
    """A connection."""

    def close(self) -> None:
        """End it. Safe to call twice."""
        ...


Link = TypeVar("Link", bound=Closable)


class PatientClient(ABC, Generic[Link]):
    """Talks with a server over a connection, which is made when it is first needed.

    Args:
        name: For messages, such as "openpi:ws://localhost:8000".
        settings: How long to wait, and how often to try.
        called: Name or file of the settings; "": they have none.

    Attributes:
        name: The same.
        connections: How many have been made.
    """

    def __init__(self, name: str, settings: DialectSettings, called: str) -> None:
        self.name = name
        self.connections = 0
        self._settings, self._called = settings, called
        self._answered = False
        self._sent: tuple[str, ...] = ()  # keys of the last observation, for messages
        self._connection: Link | None = None
        self._held: Proprioception | None = None  # the joints at the first observation since a reset

    def reset(self) -> None:
        """Let the server begin anew, once it is there. Raises PolicyError."""
        self._held = None
        self._persist(self._begin, self._settings.connect_s)

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """The next actions, (H, A).

        Raises:
            PolicyError: For a reason in docs/policy_servers.md. The connection is closed; a later call makes a new
                one.
        """
        self._held = self._held or observation["proprioception"]
        return self._persist(partial(self._ask, observation, self._held), self._settings.answer_s)

    def close(self) -> None:
        """End the connection. Safe to call at any time, twice too."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    @abstractmethod
    def _open(self, deadline: float) -> Link:
        """A connection. Raises PolicyError if there is none by then."""

    @abstractmethod
    def _meet(self, connection: Link, deadline: float) -> None:
        """Take in what a server says of itself. Raises PolicyError if it cannot be talked to."""

    @abstractmethod
    def _begin(self, connection: Link, deadline: float) -> None:
        """Have the server begin anew. Raises PolicyError."""

    @abstractmethod
    def _ask(self, observation: Mapping[str, Any], held: Proprioception, connection: Link, deadline: float) -> Array:
        """The actions (H, A) for an observation; joints without an action stay as `held`. Raises PolicyError."""

    def _persist(self, talk: Callable[[Link, float], Result], seconds: float) -> Result:
        """What a talk with the server gives; over a new connection if one is lost. Raises PolicyError."""
        deadline = time.monotonic() + seconds
        lost: Lost | None = None
        for more in range(self._settings.tries, -1, -1):
            try:
                return talk(self._connected(deadline), deadline)
            except PolicyError as error:
                self.close()
                if not isinstance(error, Lost) or not more:
                    since = f"{lost}; since then: " if lost else ""
                    reason = "server_closed" if lost and error.reason == "server_absent" else error.reason
                    raise PolicyError(reason, f"{self.name}: {since}{error}{self._doubt(error.reason)}") from None
                lost = error
                time.sleep(_PAUSE_S)
            except BaseException:  # a question without its answer: what came next would answer another
                self.close()
                raise
        raise AssertionError("unreachable")

    def _doubt(self, reason: str) -> str:
        """A hint that the settings may not fit, if a server refused the first observation without a reason."""
        if self._answered or reason not in ("server_error", "server_closed") or not self.connections:
            return ""
        others = ", ".join(name for name in paths.names("policies") if name != self._called)
        mine = f"settings {self._called}" if self._called else "settings"
        sent = f", when sent {', '.join(self._sent)[:200]}" if self._sent else ""
        return (
            f". It has answered nothing yet{sent}: the {mine} may not fit it (--policy-settings: {others}, or your own)"
        )

    def _connected(self, deadline: float) -> Link:
        if self._connection is None:
            until = min(deadline, time.monotonic() + self._settings.connect_s)
            self._connection = self._open(until)
            self.connections += 1
            self._meet(self._connection, until)
        return self._connection
