"""All through `import mpvi_bt`: check files, look at a tree, run an episode, read its result (docs/python.md)."""

import mpvi_bt

assert mpvi_bt.check("picking_up_trash") == []  # a tree, by name; files and folders too
tree = mpvi_bt.compile_plan("picking_up_trash", on_failure="retry:1")
print(tree)  # in a notebook, `tree` alone draws it
result = mpvi_bt.run("picking_up_trash", tree=tree, policy="expert", instance=1, out="runs")
print(result)
for condition in result.goal:
    print(condition.condition, condition.satisfied)
for failure in result.failures:
    print(f"given up after {failure.time_s:.0f} s: {failure.feedback or failure.reason}")
