"""An expert's episode as a ManiSkill demonstration; replayed, its actions lead to the same end.

Needs `pip install -e '.[maniskill]'` in the clone. The robot is driven by the task's tree, through ManiSkill's
recorder.
"""

import json
from pathlib import Path

import gymnasium
import h5py
from mani_skill.utils.wrappers.record import RecordEpisode

import mpvi_bt.house.maniskill  # noqa: F401  # registers MpviHouse-v1
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.episode import run

TASK = "picking_up_trash"
env = RecordEpisode(
    gymnasium.make("MpviHouse-v1", task=TASK, obs_mode="none", reward_mode="sparse"),
    "demonstrations",
    trajectory_name="expert",
    save_video=False,
    source_type="motionplanning",
    source_desc="a behavior tree with scripted skills on true poses",
)
env.reset(seed=0, options={"instance": 0})
house = env.unwrapped
house.world.step_through(env.step)
config = EpisodeConfig(TASK, policy="expert", detector="oracle", checker="oracle", sim="maniskill")
result = run(config, begun=(house.world, house.start))
print(f"recorded: {result['steps']} steps, q {result['q_score']['final']:.2f}")
env.close()

told = json.loads(Path("demonstrations/expert.json").read_text())
with h5py.File("demonstrations/expert.h5") as file:
    actions = file["traj_0/actions"][:]
again = gymnasium.make("MpviHouse-v1", **told["env_info"]["env_kwargs"])
again.reset(**told["episodes"][0]["reset_kwargs"])
for action in actions:
    info = again.step(action)[-1]
print(f"replayed: {len(actions)} steps, q {float(info['q']):.2f}")
again.close()
