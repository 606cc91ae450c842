"""The expert: a scripted policy on simulator truth.

It is the privileged upper bound and the source of demonstrations, and every report that uses it says so. Its grasps are
physical (friction); what it is spared is perception.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from mpvi_bt.executive.plan.skills import Skill
from mpvi_bt.hands.policies.scripted_policy import ScriptedPolicy
from mpvi_bt.house.truth.true_scene import TrueScene, Truth


class ExpertPolicy(ScriptedPolicy):
    """`mpvi_bt.ground.protocols.Policy` that reads simulator truth and needs no pictures."""

    name = "expert"

    def __init__(
        self, truth: Truth, skills: Mapping[str, Skill], seed: int = 0, timer: Callable[[], float] | None = None
    ) -> None:
        """Work in the world of `truth`; the same seed plans the same motions."""
        super().__init__(TrueScene(truth), skills, seed, timer)
