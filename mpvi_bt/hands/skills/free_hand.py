"""A hand for the next thing: what no place was found for is set down where the robot stands."""

from __future__ import annotations

from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.motion import Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import SIDES, Side
from mpvi_bt.hands.motion.work import Perform, Words, Work
from mpvi_bt.hands.skills.place import set_on_floor


def with_a_free_hand(perform: Perform) -> Perform:
    """A motion that, where hands are full, has what is in its way set down on the floor, and begins anew.

    Our choice: the payload was left in the hand by an earlier unit that could not set it down. Kept there, it would
    make every later unit fail, too.
    """

    def freed(work: Work, words: Words, tried: list[Array]) -> Actions:
        for _ in SIDES:
            try:
                yield from perform(work, words, tried)
                return
            except MotionFailure as failure:
                side = _in_the_way(work, words.get("hand"))
                if failure.reason != "hands_full" or side is None:
                    raise
            yield from set_on_floor(work, side, [])
        yield from perform(work, words, tried)

    return freed


def _in_the_way(work: Work, wanted: str | None) -> Side | None:
    """The full hand that is wanted; of both the one without a container, which is carried along to be filled."""
    held = {s: h.name for s, h in work.held().items() if wanted in (None, s)}
    return min(held, key=lambda s: bool(work.scene.volumes(held[s])), default=None)
