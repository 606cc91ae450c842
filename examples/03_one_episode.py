"""One whole episode from Python: the house, the robot, the tree, the score."""

from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.episode import run

result = run(EpisodeConfig(task="picking_up_trash", instance=0, seed=0))

print(f"q = {result['q_score']['final']:.2f} after {result['time']['simulator_time']:.0f} simulated seconds")
for condition in result["goal"]:
    print(f"  [{'x' if condition['satisfied'] else ' '}] {condition['condition']}")
print(f"simulator truth was read by {', '.join(result['privileged'])}")
