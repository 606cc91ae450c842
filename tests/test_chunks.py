"""Laws of action chunks: how much of each is carried out, how overlapping ones are averaged, when they are dropped."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.executive.actions.chunks import RecedingHorizon, TemporalEnsemble
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.ground.errors import PolicyError, UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import Policy
from mpvi_bt.testing import GripPolicy, KinematicRobot, check_policy
from tests.bench import Bench
from tests.layouts import ACTION_SIZE


class Foreseeing:
    """Foresees at its call k, for the step j after it, a base speed of `what(k, j)`."""

    name, note = "foreseeing", "thinking"
    cameras: tuple[str, ...] = ("head",)

    def __init__(self, length: int, what: Any) -> None:
        self.length, self.what, self.calls, self.resets = length, what, 0, 0

    def reset(self) -> None:
        self.resets += 1

    def infer(self, observation: Mapping[str, Any]) -> Array:
        chunk = np.zeros((self.length, ACTION_SIZE))
        chunk[:, 0] = [self.what(self.calls, j) for j in range(self.length)]
        self.calls += 1
        return chunk


def ask(policy: Policy, prompt: str = "pick up the cup") -> Array:
    return policy.infer({"prompt": prompt, "proprioception": KinematicRobot().proprioception(), "images": {}})


@given(length=st.integers(1, 20), horizon=st.integers(1, 20))
def test_a_receding_horizon_carries_out_the_beginning(length: int, horizon: int) -> None:
    """The first actions of the chunk, no more than the horizon, unchanged."""
    policy = RecedingHorizon(Foreseeing(length, lambda call, j: 100 * call + j), horizon)
    for call in range(3):
        np.testing.assert_array_equal(ask(policy)[:, 0], 100 * call + np.arange(min(length, horizon)))


@pytest.mark.parametrize("make", [lambda p: RecedingHorizon(p, 2), TemporalEnsemble])
def test_overlapping_chunks_tell_how_far_they_disagree(make: Any) -> None:
    """Not at the first chunk; then by as much as the arm joints' targets differ; after a reset not at all."""

    class Arms(Foreseeing):
        def infer(self, observation: Mapping[str, Any]) -> Array:
            chunk = super().infer(observation)
            chunk[:, 16] = 0.3 * self.calls
            return chunk

    policy = make(Arms(5, lambda call, j: 0.0))
    said = []
    for _ in range(3):
        ask(policy)
        said.append(policy.disagreement)
    assert said == pytest.approx([0.0, 0.3, 0.3])
    policy.reset()
    assert policy.disagreement == 0.0


@given(length=st.integers(1, 12), steps=st.integers(1, 30), decay=st.floats(0, 2), seed=st.integers(0, 99))
def test_an_ensemble_averages_what_was_foreseen_for_this_step(length: int, steps: int, decay: float, seed: int) -> None:
    """At step t, chunk k < t foresaw its action t - k; the oldest of those that reach so far weighs most."""
    foreseen = np.random.default_rng(seed).normal(size=(steps, length))
    policy = TemporalEnsemble(Foreseeing(length, lambda call, j: foreseen[call, j]), decay)
    for t in range(steps):
        (action,) = ask(policy)
        calls = [k for k in range(t + 1) if t - k < length]
        weights = [np.exp(-decay * i) for i in range(len(calls))]
        wanted = sum(w * foreseen[k, t - k] for w, k in zip(weights, calls, strict=True)) / sum(weights)
        assert action[0] == pytest.approx(wanted, abs=1e-12)


def test_an_ensemble_of_chunks_that_agree_changes_nothing() -> None:
    """Where every chunk foresees the same, that is done."""
    policy = TemporalEnsemble(Foreseeing(8, lambda call, j: float(call + j)))
    assert [float(ask(policy)[0, 0]) for _ in range(20)] == pytest.approx(list(range(20)))


@pytest.mark.parametrize("change", ["reset", "prompt"])
def test_what_was_foreseen_is_dropped_at_a_handoff_and_with_another_prompt(change: str) -> None:
    """The next action is that of the newest chunk alone."""
    policy = TemporalEnsemble(inner := Foreseeing(8, lambda call, j: float(call)))
    for _ in range(5):
        ask(policy)
    if change == "reset":
        policy.reset()
        assert inner.resets == 1
    assert ask(policy, "pick up the cup" if change == "reset" else "put it down")[0, 0] == 5.0


class Giving(Foreseeing):
    """Gives what it is told to."""

    def infer(self, observation: Mapping[str, Any]) -> Any:
        return self.what


@pytest.mark.parametrize("wrap", [lambda p: RecedingHorizon(p, 4), TemporalEnsemble])
@pytest.mark.parametrize(
    "given",
    [
        [[1.0, 2.0], [3.0]],
        None,
        "text",
        {"actions": np.zeros((1, 23))},
        np.zeros(23),
        np.zeros((0, 23)),
        np.zeros((2, 3)),
        np.full((1, 23), np.nan),
    ],
    ids=str,
)
def test_what_is_no_chunk_is_a_bad_reply_through_a_wrapper_too(wrap: Any, given: Any) -> None:
    """As it is where nothing is wrapped around the policy."""
    with pytest.raises(PolicyError) as caught:
        ask(wrap(Giving(1, given)))
    assert caught.value.reason == "bad_reply"


def test_a_reply_of_a_server_is_no_chunk() -> None:
    """What openpi's clients are given is a mapping; a class of one's own that gives it is told what is wanted."""
    with pytest.raises(PolicyError, match="a mapping with 'actions', not the array of actions itself"):
        ask(RecedingHorizon(Giving(1, {"actions": np.zeros((1, 23))}), 4))


@pytest.mark.parametrize("horizon", [0, -1, 2.5, True, "8", None])
def test_a_horizon_is_a_whole_number_of_actions(horizon: Any) -> None:
    """At least one: less would carry out nothing, or the wrong end of the chunk."""
    with pytest.raises(UserError, match="at least 1"):
        RecedingHorizon(Foreseeing(3, lambda call, j: 0.0), horizon)


@pytest.mark.parametrize("decay", [-0.1, np.inf, np.nan, True, "0.1", None])
def test_a_decay_is_a_finite_number(decay: Any) -> None:
    """Not below zero: then chunks would count the more the older they are, without limit."""
    with pytest.raises(UserError, match="at least 0"):
        TemporalEnsemble(Foreseeing(3, lambda call, j: 0.0), decay)


@pytest.mark.parametrize("wrap", [lambda p: RecedingHorizon(p, 4), TemporalEnsemble])
def test_a_wrapped_policy_is_one(wrap: Any) -> None:
    """It keeps the contract, and has the name, cameras and note of the policy."""
    check_policy(wrap(GripPolicy(load_skills())))
    policy = wrap(inner := Foreseeing(3, lambda call, j: 0.0))
    assert (policy.name, policy.note, policy.cameras) == ("foreseeing", "thinking", ("head",))
    inner.cameras = ()
    assert policy.cameras == (), "cameras are read anew each time"


def test_a_new_prompt_under_way_drops_the_chunk_and_resets_the_policy() -> None:
    """A prompt from the blackboard that changes while the policy is at work is a handoff, too."""
    bench = Bench("manipulate: pick up the $what", what="cup")
    policy = bench.context.policy = Foreseeing(100, lambda call, j: 0.001 * (100 * call + j))
    bench.run(10)
    assert (policy.calls, policy.resets) == (1, 1)
    bench.context.blackboard["what"] = "bowl"
    bench.run(1)
    assert (policy.calls, policy.resets) == (2, 2)
    assert bench.world.robot.action[0] == pytest.approx(0.1)
