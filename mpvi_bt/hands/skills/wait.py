"""Waiting: the robot holds still while something happens by itself, such as food that cooks in a microwave."""

from __future__ import annotations

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.motion import Actions
from mpvi_bt.hands.motion.work import Words, Work

# Our choice: in a fridge, a microwave or an oven, or on a stove, things freeze or cook within 15 s (`rules.heat`); no
# picture shows what is behind a closed door, so it is time that ends the wait.
WAIT_S = 20.0


def wait(work: Work, words: Words, tried: list[Array]) -> Actions:
    """Hold still for `WAIT_S`, whatever the words name."""
    yield from work.motion.wait(WAIT_S)
