"""What a tree is about is read from its targets and prompts."""

from __future__ import annotations

from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.tree.relevant import task_relevant
from mpvi_bt.executive.tree.yaml_io import parse_tree
from mpvi_bt.runs.choices.config import EpisodeConfig
from mpvi_bt.runs.episode.prepare import prepare

SKILLS = load_skills()


def test_targets_and_things_of_prompts_each_once() -> None:
    """Without articles and hands."""
    prepared = prepare(EpisodeConfig("picking_up_trash"))
    assert task_relevant(prepared.spec, prepared.skills) == ("trash can", "can of soda")


def test_what_only_the_run_knows_is_left_out() -> None:
    """A reference to the blackboard names nothing yet; rooms to look in are no things."""
    spec = parse_tree(
        """
tree: tidy
root:
  sequence: tidy
  memory: true
  children:
    - navigate: $thing
      room: kitchen
    - navigate: the red cup
    - manipulate: pick up the red cup, then put it in the sink with the left hand
blackboard: {thing: cup}
""",
        skills=SKILLS,
    )
    assert task_relevant(spec, SKILLS) == ("red cup", "sink")
