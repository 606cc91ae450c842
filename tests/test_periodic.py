"""Laws of polling, the ablation of proprioceptive triggers, and of how triggers are chosen."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.executive.completion.periodic import PeriodicTriggers
from mpvi_bt.executive.completion.triggers import ProprioceptiveTriggers
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.protocols import TriggerEvent
from mpvi_bt.runs.choices.backends import BACKENDS
from mpvi_bt.runs.choices.checkers import check_checker_choice, make_triggers
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.testing import KinematicRobot
from tests.bench import HELD, PICK, Bench


@given(st.integers(1, 400), st.integers(0, 2000))
def test_it_fires_every_so_many_steps_and_at_no_hand(period: int, steps: int) -> None:
    """From the reset on, whatever kinds of event are asked for; the first not at once."""
    triggers = PeriodicTriggers(period)
    triggers.reset({"grasp": 5.0})
    fired = [k for k in range(1, steps + 1) if (event := triggers.update()) and event == TriggerEvent("periodic", None)]
    assert fired == list(range(period, steps + 1, period))


def test_a_reset_begins_the_period_anew() -> None:
    """A unit is not asked about right after it began because the one before it was long."""
    triggers = PeriodicTriggers(10)
    assert [bool(triggers.update()) for _ in range(9)] == [False] * 9
    triggers.reset()
    assert [bool(triggers.update()) for _ in range(10)] == [False] * 9 + [True]


def test_a_poll_hands_the_head_cameras_picture_to_the_judge() -> None:
    """There is no hand whose view would be the right one, whatever the skill's file says of its events."""
    bench = Bench(PICK, {HELD: (False, True)})
    bench.context.triggers = PeriodicTriggers(7)
    bench.run()
    asked = [(q.event, q.camera, round(q.time_s * 30)) for q in bench.context.log.queries]
    assert asked == [("periodic", "head", 6), ("periodic", "head", 13)]


def test_triggers_are_chosen_by_name() -> None:
    """Every one that is listed can be made."""
    robot = KinematicRobot()
    made = {given: make_triggers(given, robot) for given in ("proprioceptive", "periodic:300")}
    assert {given.partition(":")[0] for given in made} == set(BACKENDS["trigger"])
    assert isinstance(made["proprioceptive"], ProprioceptiveTriggers)
    assert [bool(made["periodic:300"].update()) for _ in range(300)] == [False] * 299 + [True]


@pytest.mark.parametrize(
    ("trigger", "said"),
    [
        ("periodic", "such as periodic:STEPS"),
        ("periodic:", "such as periodic:STEPS"),
        ("periodic:0", "whole number of steps from 1 .* such as periodic:300, not '0'"),
        ("periodic:-5", "whole number"),
        ("periodic:10 s", "whole number"),
        ("periodic:1e3", "whole number"),
        ("periodic:\u0663", "whole number"),
        ("periodic:99999999999999999999", "whole number"),
        ("proprioceptive:300", "has no address"),
        ("preiodic:300", "Did you mean 'periodic'"),
    ],
)
def test_triggers_that_cannot_be_are_refused_before_anything_starts(trigger: str, said: str) -> None:
    """With what would be valid."""
    with pytest.raises(UserError, match=said):
        check_checker_choice(replace(EpisodeConfig("t"), trigger=trigger))


def test_a_result_names_its_triggers() -> None:
    """They can change the outcome."""
    assert EpisodeConfig("t", trigger="periodic:300").record()["trigger"] == "periodic:300"
    assert EpisodeConfig("t").backends["trigger"] == "proprioceptive"
