"""A random rollout in the ManiSkill environment: what is observed, and how rewards add up to q.

Needs `pip install -e '.[maniskill]'` in the clone.
"""

import gymnasium

from mpvi_bt.house.maniskill import MpviHouseEnv  # registers MpviHouse-v1

env = gymnasium.make(
    "MpviHouse-v1",
    task="picking_up_trash",
    obs_mode="state_dict",
    control_mode="pd_joint_target_delta_pos",
    max_episode_steps=90,  # three seconds
)
obs, info = env.reset(seed=1)  # the seed draws one of the task's instances
house = env.unwrapped
assert isinstance(house, MpviHouseEnv)
print("instance", house.instance)
for name, pose in obs["extra"]["objects"].items():
    print(f"{name:24} at", *(f"{x:.2f}" for x in pose[0, :3].tolist()), "m")

env.action_space.seed(1)
total, over = 0.0, False
while not over:
    obs, reward, terminated, truncated, info = env.step(env.action_space.sample())
    total += float(reward)
    over = bool(terminated) or bool(truncated)
print(f"after {int(info['elapsed_steps'])} steps: q {float(info['q']):.2f}, sum of rewards {total:.2f}")
for literal, holds in info["predicates"].items():
    print("  ", literal, "holds" if holds else "does not hold")
env.close()
