"""Run the tree of a plan against doubles: a robot without physics and a judge that answers as it is told.

Good for trying a tree in a second, and for tests. The judge says no to the first drop into the trash can, so that unit
goes on until its time is up, is recorded as failed, and the tree advances: a plan is not lost with one segment.
"""

import sys

from mpvi_bt.executive.plan.schema import load_plan
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.ticking.live import LiveTree
from mpvi_bt.executive.ticking.loop import run_episode
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.compile import compile_plan
from mpvi_bt.ground import paths
from mpvi_bt.testing import KinematicWorld, scripted_context

skills = load_skills()
tree = Tree(compile_plan(load_plan(paths.find("tasks/plans", "picking_up_trash")), skills))
world = KinematicWorld()
context = scripted_context(
    world,
    skills,
    places={"trash can": (3.0, 1.0), "can of soda": (6.0, -2.0)},
    answers={
        "the trash can is held in a gripper": (True,),
        "a can of soda is in the trash can": (False, True),
    },
)

outcome = run_episode(tree, world, context, subscribers=[LiveTree(sys.stdout)], max_time_s=600)
print(f"\n{outcome.ticks} ticks, {outcome.time_s:.0f} simulated seconds, {outcome.wall_s['total']:.1f} s of wall time")
for failure in outcome.log.failures:
    print(f"given up: {failure.path}: {failure.reason}: {failure.evidence}")
