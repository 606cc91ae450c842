"""Laws of faults that a policy is given: how they are written, that they happen as said, and that draws repeat."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.choices.policies import disturbed
from mpvi_bt.runs.disturbances.faults import KINDS, read_faults
from mpvi_bt.runs.disturbances.faulty_policy import FaultyPolicy
from mpvi_bt.runs.disturbances.late_policy import LatePolicy
from tests.layouts import ACTION_SIZE, BASE, LAYOUT
from tests.test_latency import BODY


class Told:
    """Commands 0.5 everywhere, nine steps a chunk, and keeps its prompts."""

    name, cameras = "told", ()

    def __init__(self) -> None:
        self.prompts: list[str] = []

    def reset(self) -> None:
        pass

    def infer(self, observation: Mapping[str, Any]) -> Array:
        self.prompts.append(observation["prompt"])
        return np.full((9, ACTION_SIZE), 0.5)


def actions(policy: FaultyPolicy, chunks: int = 1, prompt: str = "pick up the cup") -> Array:
    observation = {"prompt": prompt, "proprioception": BODY, "images": {}}
    return np.concatenate([policy.infer(observation) for _ in range(chunks)])


def test_the_example_of_the_option_is_read() -> None:
    """Numbers with and without a key, units, and defaults."""
    assert read_faults("freeze:p=0.01, jitter:0.02, drift, late:400ms, wrong_object") == {
        "freeze": 0.01,
        "jitter": 0.02,
        "drift": KINDS["drift"].usual,
        "late": 0.4,
        "wrong_object": KINDS["wrong_object"].usual,
    }
    assert read_faults("late:0.4s") == read_faults("late:0.4") == read_faults("late:400 ms")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("freze", "Did you mean 'freeze'"),
        ("", "unknown fault"),
        ("freeze,freeze", "given twice"),
        ("freeze:p=2", "0 to 1"),
        ("freeze:q=0.1", "is written freeze:p="),
        ("jitter:p=0.1", "is written jitter:0.02"),
        ("jitter:-1", "0 to"),
        ("late:nan", "0 to"),
        ("jitter:much", "no number"),
    ],
)
def test_a_fault_that_cannot_be_is_refused(given: str, said: str) -> None:
    """In one line that says what is wrong."""
    with pytest.raises(UserError, match=said):
        read_faults(given)


@given(st.integers(0, 50))
def test_without_faults_the_chunks_are_the_policys(seed: int) -> None:
    """Bit for bit, and nothing is counted."""
    policy = FaultyPolicy(Told(), {}, seed)
    assert (actions(policy) == 0.5).all()
    assert not policy.happened


@given(st.sampled_from(["freeze", "jitter", "drift"]), st.integers(0, 20))
def test_the_same_run_has_the_same_faults(kind: str, seed: int) -> None:
    """By seed, handoff and step; another seed has others."""
    once, again, other = (actions(FaultyPolicy(Told(), {kind: 0.05}, s), chunks=20) for s in (seed, seed, seed + 1))
    np.testing.assert_array_equal(once, again)
    assert (once != other).any()


def test_a_frozen_policy_stands_still_until_the_next_handoff() -> None:
    """With p = 1 from the first step on: the targets of before, the base at rest."""
    policy = FaultyPolicy(Told(), {"freeze": 1.0})
    policy.reset()
    frozen = actions(policy, chunks=3)
    assert (frozen == frozen[0]).all()
    assert not frozen[:, BASE].any()
    np.testing.assert_allclose(frozen[0, LAYOUT.arm["right"]], BODY.arm["right"])
    assert policy.happened["freeze"] == 1


def test_jitter_is_as_large_as_said_and_drift_grows() -> None:
    """Of the arm joints alone: base, torso and fingers are the policy's."""
    arms = np.r_[LAYOUT.arm["left"], LAYOUT.arm["right"]]
    others = np.setdiff1d(np.arange(ACTION_SIZE), arms)
    shaken = actions(FaultyPolicy(Told(), {"jitter": 0.1}), chunks=100)
    assert (shaken[:, arms] - 0.5).std() == pytest.approx(0.1, rel=0.1)
    drifted = actions(FaultyPolicy(Told(), {"drift": 0.3}), chunks=20)
    off = np.sqrt(((drifted[:, arms] - 0.5) ** 2).mean(1))
    np.testing.assert_allclose(off, 0.3 * np.arange(1, 181) / 30)
    for changed in (shaken, drifted):
        assert (changed[:, others] == 0.5).all()


def test_a_wrong_object_is_another_thing_of_the_task() -> None:
    """The whole handoff long; words that are no object stay; with nothing else to take, the prompt stays."""
    inner = Told()
    prompt = "pick up the cup with the right hand, then put the cup in the sink"
    policy = FaultyPolicy(inner, {"wrong_object": 1.0}, 0, load_skills(), ("cup", "plate", "sink"))
    actions(policy, chunks=3, prompt=prompt)
    assert inner.prompts == ["pick up the plate with the right hand, then put the plate in the sink"] * 3
    assert policy.happened["wrong_object"] == 1
    alone = FaultyPolicy(inner, {"wrong_object": 1.0}, 0, load_skills(), ("cup",))
    actions(alone, prompt=prompt)
    assert inner.prompts[-1] == prompt
    assert not alone.happened


def test_a_resumed_run_draws_on_from_where_it_was() -> None:
    """Handoffs and counts of what happened come back, through a policy that is late besides, and JSON."""

    def made() -> LatePolicy:
        return LatePolicy(FaultyPolicy(Told(), {"jitter": 0.1, "freeze": 0.05}), lambda answer: 0.1 * answer)

    def chunk(policy: LatePolicy) -> Array:
        return policy.infer({"prompt": "pick up the cup", "proprioception": BODY, "images": {}})

    whole, stopped, resumed = made(), made(), made()
    for policy in (whole, stopped):
        for _ in range(3):
            policy.reset()
            chunk(policy)
    resumed.restore(json.loads(json.dumps(stopped.save())))
    assert resumed.save() == whole.save()
    for policy in (whole, resumed):
        policy.reset()
    np.testing.assert_array_equal(chunk(resumed), chunk(whole))
    assert resumed.stale_action_ratio == whole.stale_action_ratio > 0


def test_episodes_of_one_seed_have_faults_of_their_own() -> None:
    """Of another instance or task; the same episode has the same ones."""

    def steps(task: str, instance: int) -> Array:
        config = EpisodeConfig(task, instance, policy_faults="jitter")
        return disturbed(Told(), config, {}, ()).infer({"prompt": "pick up the cup", "proprioception": BODY})

    np.testing.assert_array_equal(steps("picking_up_trash", 0), steps("picking_up_trash", 0))
    assert (steps("picking_up_trash", 0) != steps("picking_up_trash", 1)).any()
    assert (steps("picking_up_trash", 0) != steps("tidying_bedroom", 0)).any()
