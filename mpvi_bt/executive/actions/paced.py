"""A policy whose rows come at a rate and in a kind of their own, carried out one a control step."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mpvi_bt.executive.actions.chunks import WrappedPolicy
from mpvi_bt.ground.action_chunk import ask
from mpvi_bt.ground.errors import PolicyError, UserError, shown
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Policy
from mpvi_bt.ground.robot.action_layout import KINDS, ActionKind
from mpvi_bt.ground.robot.action_rows import Resampler, as_absolute, check_rate, command_of, of_kind
from mpvi_bt.ground.robot.base_ramp import BaseRamp
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.ground.robot.robots import layout_of, robot_named


@dataclass(frozen=True)
class Pace:
    """How a policy's rows are carried out.

    Attributes:
        rate_hz: Rows a second.
        kind: Of the joints in them.
        said_by: Who says the rate, such as "--policy-rate" or "the server"; "": nobody, so that it is 30. Where the
            policy says another one, that too.
        contradicted: Whether it does.
    """

    rate_hz: float
    kind: ActionKind
    said_by: str
    contradicted: bool = False


class PacedPolicy(WrappedPolicy):
    """Another policy's rows as control steps: `mpvi_bt.ground.robot.action_rows` says what a row means.

    What is told here comes before what the policy itself says by its `rate_hz` and `actions`. Those are read with every
    answer: a server tells them once it is there, and of two policies each has its own. Absolute rows of 30 Hz pass as
    they are.

    Args:
        policy: Whose rows.
        rate_hz: Of the rows; None: as the policy says, or else 30.
        kind: Of the rows; None: as the policy says, or else "absolute".
        said_by: Who says `rate_hz`.
        to_hz: Of the answers; None: rows pass as they are, but where an observation says its `rate_hz`.

    Attributes:
        pace: Of the last answer; None before the first.
    """

    def __init__(
        self,
        policy: Policy,
        rate_hz: float | None = None,
        kind: ActionKind | None = None,
        said_by: str = "",
        to_hz: float | None = CONTROL_HZ,
    ) -> None:
        super().__init__(policy)
        self._given, self._kind, self._said_by, self._to_hz = rate_hz, kind, said_by, to_hz
        self._rows: Resampler | None = None
        self._ramp = BaseRamp()
        self.pace: Pace | None = None

    @property
    def rate_hz(self) -> float | None:
        """Of the answers; None if nobody says it."""
        return self._to_hz or self._given or super().rate_hz

    @property
    def actions(self) -> ActionKind:
        """What joints in the answers are."""
        return "absolute" if self._to_hz else self._kind or super().actions

    def reset(self) -> None:
        """Forget everything, and what is left of a row."""
        super().reset()
        self._rows = None
        self._ramp.reset()

    def infer(self, observation: Mapping[str, Any]) -> Array:
        """(K, A), K >= 1. The policy is asked again where its rows are shorter than a control step.

        Raises:
            PolicyError: The policy gives no chunk, says no rate or kind, or rows that the robot can never be told.
        """
        to_hz = observation.get("rate_hz", self._to_hz)
        if to_hz is None:
            return ask(self._policy, observation)
        body = observation["proprioception"]
        before = observation["command"] if "command" in observation else command_of(body)
        robot = robot_named(body.robot)
        if self._rows is None:
            self._rows = Resampler(robot.layout)
        while True:
            rows = ask(self._policy, self._as_rows(observation, before, to_hz))
            if (pace := self._pace()) != self.pace:
                self._rows.reset()
                self.pace = pace
            start = before if self._rows.last is None else self._rows.last
            rows = as_absolute(rows, pace.kind, pace.rate_hz, start, robot)
            if pace.rate_hz == to_hz:
                return rows
            steps = self._rows.resampled(rows, pace.rate_hz, to_hz, before)
            if len(steps):
                break
        if pace.rate_hz < to_hz == CONTROL_HZ:
            velocity = robot.layout.velocity
            robot.layout.set_velocity(steps, self._ramp.ramped(velocity(steps), self._rows.at, velocity(before)))
        return steps

    def _as_rows(self, observation: Mapping[str, Any], before: Array, to_hz: float) -> Mapping[str, Any]:
        """The observation, with what is committed told in the policy's own rate and kind."""
        if self.pace is None or "committed" not in observation:
            return observation
        rate_hz, kind = self.pace.rate_hz, self.pace.kind
        rows, layout = observation["committed"], layout_of(observation["proprioception"])
        if rate_hz != to_hz:
            rows = Resampler(layout).resampled(rows, to_hz, rate_hz, before)
        return {**observation, "committed": of_kind(rows, kind, rate_hz, before, layout)}

    def _pace(self) -> Pace:
        kind = self._kind or getattr(self._policy, "actions", None) or "absolute"
        if kind not in KINDS:
            raise PolicyError("bad_reply", f"policy {self.name}: actions {shown(kind)}; known: {', '.join(KINDS)}")
        own = getattr(self._policy, "rate_hz", None)
        by = getattr(self._policy, "rate_from", "") or "the policy"
        if self._given is not None:
            other = f"; {by} says {own:g}" if isinstance(own, int | float) and own != self._given else ""
            return Pace(self._given, kind, self._said_by + other, bool(other))
        if own is None:
            return Pace(CONTROL_HZ, kind, "")
        try:
            return Pace(check_rate(own), kind, by)
        except UserError as error:
            raise PolicyError("bad_reply", f"policy {self.name}: {error}") from None
