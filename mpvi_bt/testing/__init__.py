"""Small backends without a simulator, and the contracts for these and for real ones.

Your own policy, detector, checker, navigator or robot passes the same checks as ours:

    from mpvi_bt.testing import check_policy
    check_policy(MyPolicy())

`SceneBuilder` is the exception: it puts together small worlds of the simulator, which it loads when it builds one.
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
from mpvi_bt.testing.label_segmenter import LabelSegmenter
from mpvi_bt.testing.scene_builder import SceneBuilder

__all__ = [
    "FingerTriggers",
    "GripPolicy",
    "KinematicRobot",
    "KinematicWorld",
    "LabelSegmenter",
    "SceneBuilder",
    "ScriptedChecker",
    "StraightNavigator",
    "check_checker",
    "check_detector",
    "check_navigator",
    "check_policy",
    "check_robot",
    "scripted_context",
]
