"""What hands hold, told by touch."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mpvi_bt.finding.scene.carrying import BoxAbout
from mpvi_bt.finding.scene.hands import TOUCH, Hand, HandTracker
from mpvi_bt.ground.robot.protocol import SIDES, Proprioception, Side
from mpvi_bt.hands.robots import r1

BOX = np.array([[-0.05, -0.05, 0.0], [0.05, 0.05, 0.1]])


def felt(x: float, closed: Mapping[Side, float]) -> Proprioception:
    """With the base at x [m]; hands are told to close and so far [m] apart, others open."""
    width = {s: closed.get(s, 0.1) for s in SIDES}
    command = {s: -1.0 if s in closed else 1.0 for s in SIDES}
    still, arm = {s: np.zeros(7) for s in SIDES}, r1.TRAVEL_ARM
    return Proprioception(np.array([x, 0.0, 0.0]), np.zeros(3), r1.TRAVEL_TORSO, arm, still, width, command, arm)


def test_fingers_that_have_come_to_rest_on_something_hold_it() -> None:
    """Not on their way there, and not where they meet; a hand that is first felt closed on something holds that."""
    hands, told = HandTracker[BoxAbout](), list[tuple[Hand, bool]]()
    for width in (0.1, 0.08, 0.06, *[0.05] * TOUCH.steady_steps):
        told += hands.feel(felt(0.0, {"left": width} if width < 0.1 else {}))
    assert told == []
    assert list(hands.feel(felt(0.0, {"left": 0.05}))) == [("left", True)]
    hands.take("left", None)
    assert hands.held("left") is None
    assert list(hands.feel(felt(0.0, {"left": 0.001}))) == [("left", False)]
    assert list(HandTracker[BoxAbout]().feel(felt(0.0, {"right": 0.05}))) == [("right", True)]


def test_what_two_hands_hold_goes_with_the_first_and_then_with_the_other() -> None:
    """Handed over, it is held all the time."""
    hands = HandTracker[BoxAbout]()
    hands.be(felt(0.0, {}))
    for side in SIDES:
        hands.take(side, "can")
        hands.load(side, "can", BoxAbout(BOX))
    for x, holder in enumerate(SIDES):
        hands.be(felt(float(x), {}))
        assert hands.holder("can") == holder
        box = hands.carried("can")
        assert box is not None
        np.testing.assert_allclose(box.corners, BOX + [x, 0.0, 0.0], atol=1e-9)
        hands.release(holder)
    assert hands.names() == set()


def test_what_is_taken_out_of_what_a_hand_holds_goes_with_the_hand_that_took_it() -> None:
    """The basket is set down, the can is carried on."""
    hands = HandTracker[BoxAbout]()
    hands.be(felt(0.0, {}))
    hands.take("left", "basket")
    for name in ("basket", "can"):
        hands.load("left", name, BoxAbout(BOX))
    hands.take("right", "can")
    hands.load("right", "can", BoxAbout(BOX))
    assert set(hands.release("left").loads) == {"basket"}
    assert hands.names() == {"can"}
    assert hands.carried("basket") is None
