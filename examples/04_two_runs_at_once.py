"""Two runs of one tree in one process, tick by tick in turn. They share nothing: each has its clock and blackboard."""

from mpvi_bt.executive.drawing.text import ascii_tree
from mpvi_bt.executive.ticking.dry import EmptyWorld, dry_context, dry_tree
from mpvi_bt.executive.tree.yaml_io import parse_tree

TREE = """
tree: count
blackboard: {laps: 0}
root:
  repeat: 5
  child:
    sequence: one lap
    memory: true
    children:
      - {wait: 1}
      - {set: laps, add: 1}
      - {say: lap $laps}
"""

runs = []
for _ in range(2):
    tree, world = dry_tree(parse_tree(TREE)), EmptyWorld()
    tree.setup(dry_context(world, tree))
    runs.append((tree, world))

for tick in range(120):
    for number, (tree, world) in enumerate(runs, start=1):
        if tick % number == 0:  # the second run goes at half the speed
            tree.tick()
            world.step()

for number, (tree, world) in enumerate(runs, start=1):
    print(f"run {number}: {world.time_s:.1f} s, {tree.context.blackboard['laps']} laps")
    print(ascii_tree(tree.spec, tree.states()))
