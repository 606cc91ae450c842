"""Criteria that describe an action are told from those that describe a state."""

from __future__ import annotations

import pytest

from mpvi_bt.executive.plan.action_like import action_in, verbs
from mpvi_bt.executive.plan.schema import load_plan
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.ground import paths

PLANS = sorted((paths.shipped() / "tasks" / "plans").glob("*.json"))

ACTIONS = [
    "The robot puts the object in the container",
    "the robot placed the can",
    "the robot put the soda can in the trash can",
    "the robot has picked up the cup",
    "pick up the object",
    "Pick up toys",
    "place the cup on the table",
    "placing the cup on the table",
    "picking up toys",
    "navigate to the kitchen",
    "Navigating to the kitchen",
    "go to the fridge",
    "the robot is moving to the kitchen",
    "the robot moves to the kitchen",
    "the robot navigates to the table",
    "the robot has reached the kitchen",
    "the robot has arrived at the fridge",
    "robot arrived at the sink",
    "the robot drove to the sofa",
    "the cup has been moved to the sink",
    "the plates have all been placed in the cabinet",
    "both bowls have been put into the sink",
    "the cup was placed on the table",
    "the door is being opened",
    "the cup is being carefully placed in the sink",
    "the robot is picking up the cup",
    "the robot's left hand picks up the cup",
    "the left gripper releases the can",
    "both hands lift the box",
    "the grippers release the box",
    "the robot will open the door",
    "the robot should place the cup on the table",
    "the robot tries to open the fridge",
    "the fridge is open and the robot takes the milk",
    "the robot opens the fridge",
    "I pick up the cup",
    "you have closed the door",
    "it drops the can",
    "carefully put the cup down",
    "to open the door",
    "open the fridge",
    "Close the door.",
    "turn on the radio",
    "turn the radio on",
    "press the button",
    "wipe the table",
    "hold the cup",
    "grasp the handle",
    "move to the table",
    "the robot hands the cup to the person",
    "the robot has finished placing the cups",
    "the robot is done wiping the table",
    "someone is placing the cup on the table",
    "the robot slices the onion",
    "the onion has been diced",
    "the robot went to the kitchen",
    "the arm lifts the box",
    "Bring the box to the garage",
    "Remove the lid",
    "the cup gets placed in the sink",
    "the robot returns to the table",
    "robot grabs can",
    "robot pick up the can",
    "the robot can pick up the cup",
    "the robot\u2019s gripper opens",
    "The robot successfully places the plate on the counter",
    "Place both pizzas in the fridge",
    "the robot turned off the lamp",
    "the robot dropped it",
    "The agent enters the kitchen",
]

STATES = [
    "The object is in the container",
    "The robot is in the kitchen area",
    "The object is held in the robot's gripper",
    "there are two soda cans in the trash can",
    "the can is in the trash can",
    "there is one soda can in the trash can",
    "the robot is at the trash can",
    "the cup is placed on the table",
    "the cup is put in the sink",
    "Place mats are on the table",
    "the place mat is on the table",
    "the cutting board is on the counter",
    "the chopping board is clean",
    "cutting board is in the sink",
    "the frying pan is on the stove",
    "the packing box holds both apple halves",
    "the robot holds the cup",
    "the robot is holding the cup",
    "the robot is grasping the handle",
    "the robot has the cup in its left hand",
    "the robot has an empty gripper",
    "the robot stands in front of the fridge",
    "robot positioned in front of the counter",
    "robot located near the sink",
    "the gripper is closed around the cup",
    "gripper closed around the cup",
    "robot arm raised",
    "robot arms are folded",
    "robot hands are empty",
    "the robot hands are empty",
    "both hands are free",
    "the door is open",
    "the door is closed",
    "the fridge door is fully closed",
    "the lamp is turned off",
    "the radio is turned on",
    "the radio is on and plays music",
    "the radio is playing",
    "the water is running",
    "the water is boiling",
    "the cabbage is cooked and diced",
    "the onion is cut into pieces",
    "the bacon is cooking in the pan",
    "the table is clean",
    "the table is wiped clean",
    "the picture is hung on the nail",
    "the poster hangs on the wall nail",
    "the hand towel is on the rack",
    "the left hand holds the box",
    "the toy robot is in the box",
    "close to the sofa is the robot",
    "the robot is close to the table",
    "the washing machine is closed",
    "the sweeping brush is in the closet",
    "the light has been on",
    "the set of keys is in the bowl",
    "set of keys is in the bowl",
    "open door of the fridge is visible",
    "the box is lifted off the floor",
    "the box is held with both hands",
    "one can of soda is in the trash can",
    "all three candles are in the cabinet",
    "no toys are left on the floor",
    "the leaves are in the bag",
    "leaves cover the floor",
    "the watering can is on the floor",
    "the spray bottle is in the robot's hand",
    "the drying rack is empty",
    "the cup is standing on the table",
    "the cup is lying next to the bowl",
    "the cup and place mats are on the table",
    "the laptop is on the desk and closed",
    "the dust is gone from the table",
    "the plant is sprayed",
    "both tree trunks are covered with pesticide",
    "the robot faces the sink",
    "the robot is next to the return slot",
    "the drawer is pulled out",
    "the hand soap is on the sink",
    "nothing is left in the basket",
    "the robot touches the button",
    "the fireplace is lit",
    "the firewood is burning",
    "the lighter is off",
    "the two storage containers are stacked",
    "the notebook is on top of the folder",
    "the camera is attached to the tripod",
    "the gift boxes are under the Christmas tree",
    "the pizza is baked",
    "the robot's base is within reach of the table",
    "robot is within 1 m of the sofa",
    "the robot arm is lifted",
    "the cup is in front of the robot",
    "the grip is firm",
    "the cleaning cloth is in the gripper",
    "the pour spout is over the bowl",
    "the sink is filled with water",
    "the robot's gripper is open and empty",
    "the robot is ready to place the cup",
    "all dishes are washed",
    "the carton of milk is inside the refrigerator and the refrigerator is closed",
    "clean plates are in the cabinet",
    "Open jars stand on the counter",
    "empty bottles are in the bin",
    "light bulbs are in the box",
    "sort order is alphabetical",
    "Picking basket is full",
    "the moving box is in the garage",
    "the mixing bowl contains both leeks and both broccoli",
    "water covers the plant",
    "the robot is inside the kitchen, close to the counter",
    "it is closed",
    "they are next to each other",
    "the robot, which holds the can, is at the bin",
]


@pytest.mark.parametrize("criterion", ACTIONS)
def test_an_action_is_told(criterion: str) -> None:
    """What a hand does, did or should do, and what is being or has been done, is no state."""
    assert action_in(criterion) is not None
    assert action_in(f"  {criterion.upper()} ") is not None


@pytest.mark.parametrize("criterion", STATES)
def test_a_state_is_left_alone(criterion: str) -> None:
    """What holds in one picture is no action, whatever words it has in common with one."""
    assert action_in(criterion) is None


@pytest.mark.parametrize("path", PLANS, ids=lambda p: p.stem)
def test_recorded_plans_describe_states(path: object) -> None:
    """No criterion of a shipped plan is taken for an action."""
    plan = load_plan(str(path))
    assert [s.completion_criterion for s in plan.segments if action_in(s.completion_criterion)] == []


def test_what_skills_end_in_is_a_state() -> None:
    """The sentence of every skill's end is no action, and what it is asked for by is one as a criterion."""
    for skill in load_skills().values():
        assert skill.shows is None or action_in(skill.shows.replace("{", "").replace("}", "")) is None
        assert [verb for verb in skill.verbs if action_in(f"{verb} the cup") is None] == []


def test_an_order_is_told_whatever_its_verb() -> None:
    """Every verb of the rule is an action as an order with a thing."""
    assert [verb for verb in verbs() if action_in(f"{verb} the cup") is None] == []
