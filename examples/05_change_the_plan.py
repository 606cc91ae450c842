"""Stop a run between two ticks, go on in what might be another process, and put a new plan in place of the rest."""

import json

from mpvi_bt.executive.drawing.text import ascii_tree
from mpvi_bt.executive.ticking.dry import EmptyWorld, dry_context, dry_tree
from mpvi_bt.executive.ticking.saved_run import SavedRun, restore_world, save_run
from mpvi_bt.executive.tree.saving import restore
from mpvi_bt.executive.tree.yaml_io import parse_tree

TREE = """
tree: errands
root:
  sequence: errands
  memory: true
  children:
    - {navigate: kitchen}
    - timeout: 20
      child: {wait: 9}
    - {navigate: bedroom}
"""
NEW = """
tree: rest
root:
  sequence: instead
  memory: true
  children:
    - {say: the bedroom can wait}
    - {navigate: living room}
"""

spec = parse_tree(TREE)
tree, world = dry_tree(spec), EmptyWorld()
tree.setup(dry_context(world, tree))
for _ in range(150):  # 5 simulated seconds
    tree.tick()
    world.step()
text = save_run(tree, world).model_dump_json()
print(f"saved at {world.time_s:.1f} s as {len(text)} characters of JSON")

tree, world = dry_tree(spec), EmptyWorld()
saved = SavedRun.model_validate(json.loads(text))
context = dry_context(world, tree)
restore_world(saved, world, context)
tree.setup(context)
restore(tree, saved.tree)
print(ascii_tree(spec, tree.states()))

tree.swap_rest("errands/navigate#2", [parse_tree(NEW).root])
print(f"\nthe plan changes at {world.time_s:.1f} s")
while tree.tick().value == "RUNNING":
    world.step()
print(ascii_tree(tree.spec, tree.states()))
