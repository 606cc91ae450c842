"""From a plan to a tree, drawn and written as YAML. Needs no simulator.

Consecutive manipulation segments become one unit, with the criterion of the last.
"""

from mpvi_bt.executive.drawing.text import ascii_tree
from mpvi_bt.executive.plan.schema import Manipulation, Navigation, Plan
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.tree.compile import compile_plan
from mpvi_bt.executive.tree.yaml_io import dump_tree, parse_tree

plan = Plan(
    task_name="clearing_a_cup",
    instruction="Put the cup from the dining table in the sink.",
    segments=(
        Navigation(
            type="navigation",
            description="go to the cup",
            completion_criterion="the robot is at the cup",
            target="cup",
            room="dining room",
        ),
        Manipulation(
            type="manipulation",
            description="pick up the cup",
            completion_criterion="the cup is held in a gripper",
        ),
        Navigation(
            type="navigation",
            description="go to the sink",
            completion_criterion="the robot is at the sink",
            target="sink",
        ),
        Manipulation(
            type="manipulation",
            description="put the cup in the sink",
            completion_criterion="the cup is in the sink",
        ),
    ),
)

tree = compile_plan(plan, load_skills())
print(ascii_tree(tree))

text = dump_tree(tree)
print(f"\nThe same as YAML, {len(text.splitlines())} lines, reads back equal: {parse_tree(text) == tree}")
