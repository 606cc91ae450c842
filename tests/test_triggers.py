"""Laws of the proprioceptive triggers, on hands that are told what to feel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpvi_bt.executive.completion.triggers import ProprioceptiveTriggers, Thresholds
from mpvi_bt.ground.errors import UnknownName
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.protocols import TriggerEvent
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, SIDES, Proprioception, Side
from tests.navigation_maps import KinematicRobot
from tests.test_squeeze import TORSO, facing_hands


class Hands(KinematicRobot):
    """Hands whose widths [m], commands and joint angles [rad] are set by the test."""

    def __init__(self) -> None:
        super().__init__(0.0, 0.0)
        self.angles: dict[Side, Array] = {"left": np.zeros(7), "right": np.zeros(7)}
        self.torso = np.zeros(4)

    def proprioception(self) -> Proprioception:
        """As set. The speeds that it reports are those of a loaded arm that stands: never zero."""
        angles = {side: angle.copy() for side, angle in self.angles.items()}
        felt = replace(super().proprioception(), torso=self.torso.copy())
        return replace(felt, arm=angles, arm_velocity=dict.fromkeys(angles, np.full(7, 0.12)))


def grips(hands: Hands, thresholds: Thresholds | None = None) -> ProprioceptiveTriggers:
    """Triggers that watch for grasps and releases."""
    triggers = ProprioceptiveTriggers(hands, thresholds)
    triggers.reset({"grasp": None, "release": None})
    return triggers


def go(
    hands: Hands,
    triggers: ProprioceptiveTriggers,
    seconds: float,
    side: Side = "right",
    to_m: float | None = None,
    command: float | None = None,
    joint_speed: float = 0.0,
) -> list[TriggerEvent]:
    """Let time pass while one hand's width goes steadily `to_m`; what fired."""
    steps = round(seconds * CONTROL_HZ)
    width, given_command = hands.gripper[side]
    widths = np.linspace(width, width if to_m is None else to_m, steps + 1)[1:]
    events = []
    for w in widths:
        hands.gripper[side] = (float(w), given_command if command is None else command)
        hands.angles[side] += joint_speed / CONTROL_HZ
        if (event := triggers.update()) is not None:
            events.append(event)
    return events


def grasp(hands: Hands, triggers: ProprioceptiveTriggers, width_m: float = 0.06) -> list[TriggerEvent]:
    """Close on something, lift it, come to rest."""
    return (
        go(hands, triggers, 0.5, to_m=width_m, command=-1.0)
        + go(hands, triggers, 1.0, joint_speed=0.5)
        + go(hands, triggers, 1.5)
    )


@settings(max_examples=20, deadline=None)
@given(st.floats(0.004, 0.088))
def test_a_grasp_fires_once_when_the_arm_has_come_to_rest(width_m: float) -> None:
    """Closing and holding at a nonzero width, then the lift, then rest: one event, of that hand, at the end."""
    hands = Hands()
    triggers = grips(hands)
    assert go(hands, triggers, 0.5) == []
    assert go(hands, triggers, 0.5, to_m=width_m, command=-1.0) == []
    assert go(hands, triggers, 1.0, joint_speed=0.5) == [], "fired in the middle of the lift"
    assert go(hands, triggers, 5.0) == [TriggerEvent("grasp", "right")]


def test_a_release_waits_for_the_other_arm() -> None:
    """While the other hand still brings the container home, nothing has ended."""
    hands = Hands()
    hands.gripper["left"] = (0.016, -1.0)
    triggers = grips(hands)
    triggers.reset({"release": None})
    grasp(hands, triggers)
    assert go(hands, triggers, 0.5, to_m=0.1, command=1.0) == []
    assert go(hands, triggers, 3.0, "left", joint_speed=0.3) == []
    assert go(hands, triggers, 1.0, "left") == [TriggerEvent("release", "right")]


def test_an_empty_hand_fires_nothing() -> None:
    """Closing on nothing ends at zero width."""
    hands = Hands()
    triggers = grips(hands)
    assert grasp(hands, triggers, width_m=0.0005) == []


def test_a_hand_that_pauses_half_way_without_being_told_to_close_has_no_grasp() -> None:
    """A width that holds is a grasp only if the hand was commanded closed."""
    hands = Hands()
    triggers = grips(hands)
    assert go(hands, triggers, 0.5, to_m=0.05, command=0.0) + go(hands, triggers, 3.0) == []


def test_a_release_is_noticed_before_the_arm_moves_away() -> None:
    """In one step, while the hand is where it let go; the event follows when the arms rest."""
    hands = Hands()
    triggers = grips(hands)
    grasp(hands, triggers)
    noticed: list[Side | None] = []
    update = triggers.update
    triggers.update = lambda: (update(), noticed.append(triggers.released))[0]  # type: ignore[method-assign, func-returns-value]
    assert go(hands, triggers, 0.3, to_m=0.1, command=1.0) + go(hands, triggers, 0.5) == []
    assert [side for side in noticed if side] == ["right"]
    noticed.clear()
    assert go(hands, triggers, 0.5, joint_speed=0.4) + go(hands, triggers, 3.0) == [TriggerEvent("release", "right")]
    assert set(noticed) == {None}


@pytest.mark.parametrize("width_m", [0.02, 0.06, 0.088])
def test_letting_go_after_a_grasp_fires_a_release(width_m: float) -> None:
    """Even of a thing so wide that the hand has little left to open."""
    hands = Hands()
    triggers = grips(hands)
    assert grasp(hands, triggers, width_m)
    assert go(hands, triggers, 0.5, to_m=0.1, command=1.0) == []
    assert go(hands, triggers, 0.5, joint_speed=0.4) == []
    assert go(hands, triggers, 3.0) == [TriggerEvent("release", "right")]


def test_a_hand_need_not_be_told_to_open_wide_to_have_let_go() -> None:
    """A careful one opens just enough: what it is told lies between shut and the width that it has."""
    hands = Hands()
    triggers = grips(hands)
    assert grasp(hands, triggers, 0.007)
    assert go(hands, triggers, 0.5, to_m=0.024, command=-0.4) == []
    assert go(hands, triggers, 0.5, joint_speed=0.4) + go(hands, triggers, 3.0) == [TriggerEvent("release", "right")]


@given(st.floats(-1.0, 0.0), st.floats(0.004, 0.045))
@settings(max_examples=20, deadline=None)
def test_fingers_that_stop_short_of_where_they_are_told_to_be_hold_something(told: float, short_m: float) -> None:
    """Learned policies seldom say shut; fingers that get where they are told to be hold nothing."""
    for width_m, events in (((told + 1) * 0.05 + short_m, [TriggerEvent("grasp", "right")]), ((told + 1) * 0.05, [])):
        hands = Hands()
        triggers = grips(hands)
        fired = go(hands, triggers, 0.5, to_m=width_m, command=told) + go(hands, triggers, 1.0, joint_speed=0.5)
        assert fired + go(hands, triggers, 3.0) == events


def test_opening_an_empty_hand_is_no_release() -> None:
    """Only what was held can be let go."""
    hands = Hands()
    hands.gripper["right"] = (0.0, -1.0)
    triggers = grips(hands)
    assert go(hands, triggers, 1.0) == []
    assert go(hands, triggers, 0.5, to_m=0.1, command=1.0) + go(hands, triggers, 2.0) == []


def test_what_is_held_from_the_start_is_no_news_but_its_release_is() -> None:
    """A bin carried in the left hand asks no question while the right hand works."""
    hands = Hands()
    hands.gripper["left"] = (0.016, -1.0)
    triggers = grips(hands)
    assert go(hands, triggers, 2.0, "left", joint_speed=0.3) + go(hands, triggers, 3.0, "left") == []
    assert go(hands, triggers, 0.5, "left", to_m=0.1, command=1.0) == []
    assert go(hands, triggers, 2.0, "left") == [TriggerEvent("release", "left")]


@settings(max_examples=20, deadline=None)
@given(st.floats(0.004, 0.03))
def test_a_hand_that_begins_to_open_has_not_let_go(width_m: float) -> None:
    """Also of the wall of a box: it is told to be as wide as that for a moment, and stands around it still."""
    hands = Hands()
    triggers = grips(hands)
    grasp(hands, triggers, width_m)
    for told_m in np.linspace(0.0, width_m + 0.02, 15):  # in half a second
        assert go(hands, triggers, 1 / CONTROL_HZ, to_m=max(width_m, told_m), command=2 * told_m / 0.10 - 1) == []
    assert go(hands, triggers, 0.7) == []
    assert go(hands, triggers, 1.0) == [TriggerEvent("release", "right")]


def test_something_that_slips_out_is_a_release_once_the_arms_rest() -> None:
    """A thing that was pushed out of the fingers may lie where it was to lie: that is looked at once."""
    hands = Hands()
    triggers = grips(hands)
    grasp(hands, triggers)
    assert go(hands, triggers, 0.2, to_m=0.0) + go(hands, triggers, 3.0) == [TriggerEvent("release", "right")]
    assert go(hands, triggers, 0.5, to_m=0.1, command=1.0) + go(hands, triggers, 3.0) == []


def test_after_a_no_the_event_fires_again_only_when_the_arm_moved_and_settled() -> None:
    """Standing still brings no second question; moving and settling does."""
    hands = Hands()
    triggers = grips(hands)
    assert len(grasp(hands, triggers)) == 1
    assert go(hands, triggers, 10.0) == []
    assert go(hands, triggers, 1.0, joint_speed=0.5) == []
    assert go(hands, triggers, 3.0) == [TriggerEvent("grasp", "right")]


def test_two_events_of_one_hand_keep_the_refractory_time() -> None:
    """A hand that twitches does not ask twice within the refractory time."""
    hands = Hands()
    triggers = grips(hands, Thresholds(refractory_s=3.0, settle_s=0.2))
    assert len(grasp(hands, triggers)) == 1
    assert go(hands, triggers, 0.2, joint_speed=0.5) + go(hands, triggers, 0.8) == []
    assert len(go(hands, triggers, 4.0)) == 1


def rests(hands: Hands) -> ProprioceptiveTriggers:
    """Triggers that watch for a rest."""
    triggers = ProprioceptiveTriggers(hands)
    triggers.reset({"rest": None})
    return triggers


@settings(max_examples=20, deadline=None)
@given(st.sampled_from(["left", "right"]), st.floats(0.4, 2.0), st.floats(0.1, 1.5))
def test_a_rest_after_a_way_fires_once(side: Side, way_rad: float, speed: float) -> None:
    """Whatever the arms did: one event, of the arm that went, when they have come to rest, and no more after it."""
    hands = Hands()
    triggers = rests(hands)
    assert go(hands, triggers, 3.0) == [], "nothing has moved"
    assert go(hands, triggers, way_rad / speed, side, joint_speed=speed) == []
    assert go(hands, triggers, 10.0) == [TriggerEvent("rest", side)]


def test_there_and_back_again_is_a_way() -> None:
    """A button that was pressed leaves the arm where it began."""
    hands = Hands()
    triggers = rests(hands)
    go(hands, triggers, 1.0, joint_speed=0.5)
    assert go(hands, triggers, 1.0, joint_speed=-0.5) == []
    assert go(hands, triggers, 3.0) == [TriggerEvent("rest", "right")]


def test_a_twitch_is_no_way_and_after_a_no_there_must_be_a_new_one() -> None:
    """A fifth of a radian brings no question; half a radian does, each time."""
    hands = Hands()
    triggers = rests(hands)
    assert go(hands, triggers, 0.4, joint_speed=0.5) + go(hands, triggers, 3.0) == []
    assert go(hands, triggers, 0.6, joint_speed=0.5) + go(hands, triggers, 3.0) == [TriggerEvent("rest", "right")]
    assert go(hands, triggers, 0.4, joint_speed=0.5) + go(hands, triggers, 3.0) == []
    assert go(hands, triggers, 0.6, joint_speed=-0.5) + go(hands, triggers, 3.0) == []
    assert go(hands, triggers, 0.6, joint_speed=-0.5) + go(hands, triggers, 3.0) == [TriggerEvent("rest", "right")]


def test_there_is_no_rest_while_base_or_fingers_move() -> None:
    """The picture would show the middle of something."""
    hands = Hands()
    triggers = rests(hands)
    go(hands, triggers, 1.0, joint_speed=0.5)
    for _ in range(60):
        hands.pose = hands.pose + np.array([0.004, 0.0, 0.0])
        assert triggers.update() is None
    assert go(hands, triggers, 2.0, to_m=0.05, command=0.0) == []
    assert go(hands, triggers, 3.0) == [TriggerEvent("rest", "right")]


def test_a_hand_on_a_bar_is_not_done_before_it_lets_go() -> None:
    """Who rested with the bar of a door in hand, and was sent on then, would drag the door along."""
    hands = Hands()
    triggers = rests(hands)
    go(hands, triggers, 1.0, joint_speed=0.5)
    assert go(hands, triggers, 1.0, to_m=0.02, command=-1.0) == []
    assert pulls(hands, triggers, 0.5) + go(hands, triggers, 10.0) == []
    assert go(hands, triggers, 1.0, to_m=0.1, command=1.0) + go(hands, triggers, 3.0) == [TriggerEvent("rest", "right")]


def test_a_grasp_that_is_told_of_is_no_rest_too() -> None:
    """One end, one question, where both kinds are asked for."""
    hands = Hands()
    triggers = grips(hands)
    triggers.reset({"grasp": None, "rest": None})
    assert grasp(hands, triggers) + go(hands, triggers, 5.0) == [TriggerEvent("grasp", "right")]


def pulls(hands: Hands, triggers: ProprioceptiveTriggers, way_m: float, seconds: float = 1.0) -> list[TriggerEvent]:
    """Move the base, and with it what the hands hold."""
    events = []
    for _ in range(round(seconds * CONTROL_HZ)):
        hands.pose = hands.pose + np.array([way_m / seconds / CONTROL_HZ, 0.0, 0.0])
        if (event := triggers.update()) is not None:
            events.append(event)
    return events


@settings(max_examples=20, deadline=None)
@given(st.floats(0.12, 0.8), st.floats(0.5, 3.0))
def test_what_a_hand_has_taken_hold_of_and_moved_fires_when_it_stands(way_m: float, seconds: float) -> None:
    """A door that was pulled open, the hand still on its handle: one event, whatever moved the hand."""
    hands = Hands()
    triggers = ProprioceptiveTriggers(hands)
    triggers.reset({"stop": None})
    assert go(hands, triggers, 0.5, to_m=0.02, command=-1.0) + go(hands, triggers, 1.0) == []
    assert pulls(hands, triggers, way_m, seconds) == []
    assert go(hands, triggers, 5.0) == [TriggerEvent("stop", "right")]


def test_nothing_has_stopped_that_was_not_moved_or_is_not_held() -> None:
    """A hand that holds on and stands; one that moves with nothing in it; one that carries what it came with."""
    for width_m, way_m, before in ((0.02, 0.05, False), (0.0005, 0.5, False), (0.02, 0.5, True)):
        hands = Hands()
        if before:
            hands.gripper["right"] = (width_m, -1.0)
        triggers = ProprioceptiveTriggers(hands)
        triggers.reset({"stop": None})
        events = go(hands, triggers, 0.5, to_m=width_m, command=-1.0) + go(hands, triggers, 1.0)
        assert events + pulls(hands, triggers, way_m) + go(hands, triggers, 3.0) == []


def test_after_a_no_what_is_held_must_be_moved_on() -> None:
    """A door that is pulled farther is a new end."""
    hands = Hands()
    triggers = ProprioceptiveTriggers(hands)
    triggers.reset({"stop": None})
    go(hands, triggers, 1.5, to_m=0.02, command=-1.0)
    assert len(pulls(hands, triggers, 0.3) + go(hands, triggers, 3.0)) == 1
    assert go(hands, triggers, 5.0) == []
    assert len(pulls(hands, triggers, 0.3) + go(hands, triggers, 3.0)) == 1


def test_what_nobody_has_told_us_of_may_end_in_any_way() -> None:
    """Without a skill every kind is watched for, and one end is one event still."""
    hands = Hands()
    triggers = ProprioceptiveTriggers(hands)
    assert grasp(hands, triggers) + go(hands, triggers, 3.0) == [TriggerEvent("grasp", "right")]
    assert pulls(hands, triggers, 0.5) + go(hands, triggers, 3.0) == [TriggerEvent("stop", "right")]
    opened = go(hands, triggers, 0.5, to_m=0.1, command=1.0) + go(hands, triggers, 0.5, joint_speed=0.4)
    assert opened + go(hands, triggers, 3.0) == [TriggerEvent("release", "right")]
    hands = Hands()
    triggers = ProprioceptiveTriggers(hands)
    assert go(hands, triggers, 2.0, joint_speed=0.5) + go(hands, triggers, 5.0) == [TriggerEvent("rest", "right")]


@settings(max_examples=10, deadline=None)
@given(st.sampled_from(["grasp", "rest"]), st.floats(2.0, 20.0))
def test_a_skill_may_say_how_far_apart_its_events_are(kind: str, refractory_s: float) -> None:
    """The first comes as ever; the next ones not before that time."""
    hands = Hands()
    triggers = ProprioceptiveTriggers(hands)
    triggers.reset({kind: refractory_s})
    go(hands, triggers, 0.5, to_m=0.06, command=-1.0 if kind == "grasp" else 0.2)  # a hand that took hold goes on
    speeds = [0.5 if k % 48 < 24 else 0.0 for k in range(48 * 30)]  # moves and rests by turns
    fired = [step for step, v in enumerate(speeds) if go(hands, triggers, 1 / CONTROL_HZ, joint_speed=v)]
    assert fired[0] < 2.0 * CONTROL_HZ
    assert len(fired) > 1
    assert (np.diff(fired) >= round(refractory_s * CONTROL_HZ)).all()


def test_only_the_kinds_that_were_asked_for_fire() -> None:
    """A place is not interrupted by the grasp that comes before it."""
    hands = Hands()
    triggers = grips(hands)
    triggers.reset({"release": None})
    assert grasp(hands, triggers) == []
    assert go(hands, triggers, 0.5, to_m=0.1, command=1.0) + go(hands, triggers, 2.0) == [
        TriggerEvent("release", "right")
    ]


def test_a_kind_that_does_not_exist_is_refused() -> None:
    """With the names that do."""
    with pytest.raises(UnknownName, match="grasp"):
        ProprioceptiveTriggers(Hands()).reset({"graps": None})


def test_a_noisy_width_still_makes_a_grasp() -> None:
    """Half a millimeter of sensor noise does not hide a steady hold."""
    hands = Hands()
    triggers = grips(hands, Thresholds(smoothing=0.1, still_m_s=0.005))
    rng = np.random.default_rng(0)
    go(hands, triggers, 0.5, to_m=0.06, command=-1.0)
    events = []
    for _ in range(4 * CONTROL_HZ):
        hands.gripper["right"] = (0.06 + float(rng.normal(0, 0.0003)), -1.0)
        if (event := triggers.update()) is not None:
            events.append(event)
    assert events == [TriggerEvent("grasp", "right")]


class Pressing(KinematicRobot):
    """Hands that face each other; what keeps them apart and what they are told is set by the test."""

    def __init__(self, apart_m: float, told_m: float) -> None:
        super().__init__(0.0, 0.0)
        self.arms, self.told = facing_hands(apart_m), facing_hands(told_m)

    def proprioception(self) -> Proprioception:
        """As set."""
        return replace(super().proprioception(), torso=TORSO, arm=self.arms, arm_command=self.told)


def passes(robot: KinematicRobot, triggers: ProprioceptiveTriggers, seconds: float, way_m: float = 0.0) -> list[str]:
    """Let time pass while the base drives straight on; the kinds of what fired."""
    steps = round(seconds * CONTROL_HZ)
    events = []
    for _ in range(steps):
        robot.pose = robot.pose + np.array([way_m / steps, 0.0, 0.0])
        if (event := triggers.update()) is not None:
            events.append(event.kind)
    return events


def test_hands_that_cease_to_press_a_thing_have_let_go_of_it() -> None:
    """The fingers of both are open all the while; it is told of once, when the base has come to rest, too."""
    robot = Pressing(0.30, 0.24)
    triggers = ProprioceptiveTriggers(robot)
    triggers.reset({"release": None})
    assert passes(robot, triggers, 2.0, way_m=0.5) + passes(robot, triggers, 3.0) == [], "they press it still"
    robot.arms = robot.told = facing_hands(0.40)
    assert passes(robot, triggers, 2.0, way_m=-0.5) == [], "the base moves"
    assert passes(robot, triggers, 5.0) == ["release"]
    assert passes(robot, triggers, 2.0, way_m=0.5) + passes(robot, triggers, 5.0) == ["release"], "after a no, anew"


@pytest.mark.parametrize(("apart_m", "told_m"), [(0.30, 0.30), (0.30, 0.24)])
def test_hands_that_pressed_nothing_or_press_on_have_let_go_of_nothing(apart_m: float, told_m: float) -> None:
    """Neither hands that part with nothing between them nor a squeeze that lasts is a release."""
    robot = Pressing(apart_m, told_m)
    triggers = ProprioceptiveTriggers(robot)
    triggers.reset({"release": None})
    assert passes(robot, triggers, 2.0) == []
    if apart_m == told_m:
        robot.arms = robot.told = facing_hands(0.40)
    assert passes(robot, triggers, 2.0, way_m=0.5) + passes(robot, triggers, 5.0) == []


def drives() -> tuple[Hands, ProprioceptiveTriggers]:
    """A robot that is about to drive, after the first look whether it is there already."""
    hands = Hands()
    triggers = ProprioceptiveTriggers(hands)
    triggers.reset({"arrival": None})
    assert go(hands, triggers, 3.0) == [TriggerEvent("arrival", None)], "it may be there already"
    return hands, triggers


@settings(max_examples=20, deadline=None)
@given(st.floats(0.15, 2.0), st.floats(-3.0, 3.0))
def test_a_drive_or_a_turn_that_ends_is_an_arrival(way_m: float, turn_rad: float) -> None:
    """One event, when the base stands again."""
    hands, triggers = drives()
    for _ in range(60):
        hands.pose = hands.pose + np.array([way_m, 0.0, turn_rad]) / 60
        assert triggers.update() is None
    assert go(hands, triggers, 5.0) == [TriggerEvent("arrival", None)]


def test_what_only_sways_has_not_arrived_anew() -> None:
    """A few centimeters are no drive."""
    hands, triggers = drives()
    for way_m in (0.05, -0.05, 0.05):
        for _ in range(30):
            hands.pose = hands.pose + np.array([way_m, 0.0, 0.0]) / 30
            assert triggers.update() is None
        assert go(hands, triggers, 2.0) == []


def test_a_skill_may_say_how_far_apart_its_arrivals_are() -> None:
    """As of any event: the base that stood only for a moment is asked about later."""
    hands = Hands()
    triggers = ProprioceptiveTriggers(hands)
    triggers.reset({"arrival": 5.0})
    assert len(go(hands, triggers, 1.0)) == 1
    for _ in range(30):
        hands.pose = hands.pose + np.array([0.02, 0.0, 0.0])
        assert triggers.update() is None
    assert go(hands, triggers, 2.0) == []
    assert go(hands, triggers, 3.0) == [TriggerEvent("arrival", None)]


def test_what_nobody_has_told_us_of_is_no_drive() -> None:
    """The general heuristics are of hands and arms: only a skill that drives asks for arrivals."""
    hands = Hands()
    triggers = ProprioceptiveTriggers(hands)
    for _ in range(60):
        hands.pose = hands.pose + np.array([0.02, 0.0, 0.0])
        assert triggers.update() is None
    assert go(hands, triggers, 2.0) == []


def idles() -> tuple[Hands, ProprioceptiveTriggers]:
    """A robot of which only standing still is news."""
    hands = Hands()
    triggers = ProprioceptiveTriggers(hands)
    triggers.reset({"idle": None})
    return hands, triggers


def test_who_does_no_more_is_asked_about_once() -> None:
    """After seconds without a motion, and not again before something has moved: the picture is the same."""
    hands, triggers = idles()
    assert go(hands, triggers, 2.9) == [], "it may still begin"
    assert go(hands, triggers, 60.0) == [TriggerEvent("idle", None)]
    assert go(hands, triggers, 1.0, joint_speed=0.2) + go(hands, triggers, 2.5) == []
    assert go(hands, triggers, 60.0) == [TriggerEvent("idle", None)]


def test_what_was_in_hand_before_is_looked_at_once_there_is_no_more_to_do() -> None:
    """Taking hold of it was no news, nor is anything else a policy that finds it in hand will do."""
    hands, triggers = idles()
    hands.gripper["right"] = (0.016, -1.0)
    triggers.reset({"grasp": None, "idle": None})
    assert go(hands, triggers, 60.0) == [TriggerEvent("idle", "right")]


def test_each_hand_that_holds_something_is_looked_at() -> None:
    """Either may be meant."""
    hands, triggers = idles()
    for side in SIDES:
        hands.gripper[side] = (0.016, -1.0)
    triggers.reset({"idle": None})
    assert go(hands, triggers, 60.0) == [TriggerEvent("idle", side) for side in SIDES]


def test_an_end_that_was_told_of_is_not_told_of_again_for_standing_on() -> None:
    """Of a hand that let go and a robot that has stood since, there is one picture."""
    hands, triggers = idles()
    triggers.reset({"grasp": None, "idle": None})
    assert grasp(hands, triggers) + go(hands, triggers, 60.0) == [TriggerEvent("grasp", "right")]


def test_who_has_let_go_of_nothing_yet_only_thinks() -> None:
    """What ends by letting go is not asked about before: another thing that is called so may be in the bin already."""
    hands, triggers = idles()
    hands.gripper["right"] = (0.016, -1.0)
    triggers.reset({"release": None, "idle": None})
    assert go(hands, triggers, 60.0) == []
    hands.gripper["right"] = (0.1, 1.0)
    assert go(hands, triggers, 2.0, joint_speed=0.2) + go(hands, triggers, 60.0) == [TriggerEvent("release", "right")]
    for _ in range(CONTROL_HZ):
        hands.pose = hands.pose - np.array([0.01, 0.0, 0.0])
        assert triggers.update() is None
    assert go(hands, triggers, 60.0) == [TriggerEvent("idle", None)], "from where it stands now more may be seen"


@pytest.mark.parametrize("way", ["base", "torso"])
def test_who_drives_or_bends_is_not_idle(way: str) -> None:
    """Whatever moves: where it then stands it sees something else."""
    hands, triggers = idles()
    for _ in range(round(6.0 * CONTROL_HZ)):
        if way == "base":
            hands.pose = hands.pose + np.array([0.004, 0.0, 0.0])
        else:
            hands.torso = hands.torso + 0.004
        assert triggers.update() is None
    assert go(hands, triggers, 4.0) == [TriggerEvent("idle", None)]
