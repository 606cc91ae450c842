"""Small backends that need no simulator, and the contracts that they and the real ones keep.

Your own policy, detector, checker, navigator or robot passes the same checks as ours:

    from mpvi_bt.testing import check_policy
    check_policy(MyPolicy())
"""

from mpvi_bt.testing.contracts import check_checker, check_detector, check_navigator, check_policy, check_robot
from mpvi_bt.testing.doubles import (
    FingerTriggers,
    GripPolicy,
    KinematicRobot,
    KinematicWorld,
    ScriptedChecker,
    StraightNavigator,
    scripted_context,
)

__all__ = [
    "FingerTriggers",
    "GripPolicy",
    "KinematicRobot",
    "KinematicWorld",
    "ScriptedChecker",
    "StraightNavigator",
    "check_checker",
    "check_detector",
    "check_navigator",
    "check_policy",
    "check_robot",
    "scripted_context",
]
