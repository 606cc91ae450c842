"""The very same tree drives the robot in the core's scene and in ManiSkill's.

Needs `pip install -e '.[maniskill]'` in the clone, as `mpvi run picking_up_trash --sim maniskill` does, which does the
same: it loads mpvi_bt.house.maniskill, whose environment then takes every step.
"""

from dataclasses import replace

from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.episode import run

config = EpisodeConfig("picking_up_trash", instance=1, policy="expert", detector="oracle", checker="oracle")
for sim in ("sapien", "maniskill"):
    result = run(replace(config, sim=sim))
    rate = result["steps"] / result["wall"]["loop"]["stepping"]
    print(f"{sim:10} q {result['q_score']['final']:.2f} after {result['steps']} steps, {rate:.0f} a second")
