"""Whether a robot has the hands that a tree is for."""

from __future__ import annotations

from collections.abc import Mapping

from mpvi_bt.behaviors.parameters import Prompt
from mpvi_bt.errors import UserError, shown
from mpvi_bt.plan.clauses import clauses, match
from mpvi_bt.plan.skills import Skill
from mpvi_bt.robot.model import RobotModel
from mpvi_bt.robot.protocol import SIDES
from mpvi_bt.tree.spec import TreeSpec


def check_hands(robot: RobotModel, spec: TreeSpec, skills: Mapping[str, Skill]) -> None:
    """Refuse a tree that is for other hands than a robot has.

    Raises:
        UserError: The first prompt that asks for two hands where there is one, or for a hand that is not there.
    """
    for placed in spec.nodes:
        parameters = placed.spec.parameters
        if not isinstance(parameters, Prompt):
            continue
        for clause in clauses(parameters.prompt, skills):
            call = match(clause, skills)
            if call is None:
                continue
            if call.skill.hands > len(robot.sides):
                raise UserError(
                    f"{placed.path}: {shown(clause)} takes two hands (skill {call.skill.name}); {robot.name} has one."
                )
            hand = call.arguments.get("hand")
            if hand in SIDES and hand not in robot.sides:
                raise UserError(
                    f"{placed.path}: {shown(clause)} is for the {hand} hand; {robot.name} has the {robot.sides[0]} one."
                )
