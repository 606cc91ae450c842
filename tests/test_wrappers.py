"""One law of all policies that stand before another one: what that says of itself is not lost on the way."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from mpvi_bt.executive.actions.backup import WithBackup
from mpvi_bt.executive.actions.chunks import RecedingHorizon, TemporalEnsemble, WrappedPolicy
from mpvi_bt.executive.actions.paced import PacedPolicy
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.hands.policies.demonstrated import DemonstratedPolicy
from mpvi_bt.hands.policies.pregrasp import PregraspPolicy, WithPregrasp
from mpvi_bt.runs.disturbances.answer_times import TimedPolicy
from mpvi_bt.runs.disturbances.faulty_policy import FaultyPolicy
from mpvi_bt.runs.disturbances.late_policy import LatePolicy
from tests.layouts import ACTION_SIZE
from tests.test_latency import BODY

SKILLS = load_skills()


class Saying:
    """A policy that says of itself what it is told to, once it has been asked."""

    name, cameras, planning_s = "saying", (), 0.0

    def __init__(
        self, note: str = "", gave_up: bool = False, ended: bool = False, progress: float | None = None
    ) -> None:
        self.says = {"note": note, "gave_up": gave_up, "ended": ended, "progress": progress}
        self.reset()

    def reset(self) -> None:
        self.note, self.gave_up, self.ended, self.progress = "", False, False, None

    def infer(self, observation: Mapping[str, Any]) -> Array:
        vars(self).update(self.says)
        return np.zeros((4, ACTION_SIZE))


WRAPPERS: Mapping[type, Callable[[Any], Any]] = {
    RecedingHorizon: lambda policy: RecedingHorizon(policy, 2),
    TemporalEnsemble: TemporalEnsemble,
    TimedPolicy: TimedPolicy,
    FaultyPolicy: lambda policy: FaultyPolicy(policy, {"jitter": 0.01}),
    LatePolicy: lambda policy: LatePolicy(policy, lambda answer: 0.1),
    WithPregrasp: lambda policy: WithPregrasp(policy, PregraspPolicy(SKILLS)),
    WithBackup: lambda policy: WithBackup(policy, Saying("the other"), SKILLS),
    DemonstratedPolicy: lambda policy: DemonstratedPolicy(policy, {}),
    PacedPolicy: PacedPolicy,
}


def test_every_wrapper_is_held_to_it() -> None:
    """None that ships is left out below."""
    shipped = {kind for kind in WrappedPolicy.__subclasses__() if kind.__module__.startswith("mpvi_bt.")}
    assert shipped <= set(WRAPPERS)


@pytest.mark.parametrize("kind", WRAPPERS, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize(
    "says",
    [
        {"note": "reaching", "progress": 0.25},
        {"note": "done", "ended": True, "progress": 1.0},
        {"note": "lost", "ended": True, "gave_up": True},
    ],
    ids=lambda says: says["note"],
)
def test_what_a_policy_says_of_itself_is_said_through_a_wrapper(kind: type, says: Mapping[str, Any]) -> None:
    """Its note, its progress, and that it has ended or given up; at a reset all of it is taken back."""
    policy = WRAPPERS[kind](inner := Saying(**says))
    policy.reset()
    policy.infer({"prompt": "wave", "proprioception": BODY, "images": {}})
    assert policy.note.endswith(inner.note)
    assert (policy.gave_up, policy.ended, policy.progress) == (inner.gave_up, inner.ended, inner.progress)
    policy.reset()
    assert (policy.gave_up, policy.ended, policy.progress) == (False, False, None)


def test_what_a_policy_says_of_one_prompt_of_several_is_no_end_of_all() -> None:
    """An instruction of four prompts is an eighth done when half of the first one is, and not ended with it."""
    each: Any = Saying("at it", ended=True, progress=0.5)
    policy: Any = DemonstratedPolicy(each, {"tidy up": list("abcd")})
    told = {"prompt": "tidy up", "proprioception": BODY, "images": {}}
    for done in range(4):
        policy.infer(told)
        assert (policy.ended, policy.progress) == (done == 3, (done + 0.5) / 4)


def test_the_progress_of_one_clause_of_several_is_not_that_of_the_prompt() -> None:
    """Where clauses are told one by one, how far the one at work is says nothing of the rest."""
    first = Saying("no_skill: that", gave_up=True, ended=True, progress=0.0)
    policy = WithBackup(first, Saying("at it", progress=0.5), SKILLS)
    told = {"prompt": "open the drawer, then pick up the can", "proprioception": BODY, "images": {}}
    for _ in range(3):
        policy.infer(told)
    assert (policy.ended, policy.progress) == (False, None)
