"""The motions of the skills that scripted policies know, by the skill's name."""

from __future__ import annotations

from collections.abc import Mapping

from mpvi_bt.executive.plan.skills import Skill
from mpvi_bt.ground.import_paths import imported
from mpvi_bt.hands.motion.work import Perform
from mpvi_bt.hands.skills.aim import light, spray
from mpvi_bt.hands.skills.close import close
from mpvi_bt.hands.skills.cut import cut, dice
from mpvi_bt.hands.skills.free_hand import with_a_free_hand
from mpvi_bt.hands.skills.go_to import go_to
from mpvi_bt.hands.skills.hand_over import hand_over
from mpvi_bt.hands.skills.lift import lift
from mpvi_bt.hands.skills.mount import mount
from mpvi_bt.hands.skills.open import open_
from mpvi_bt.hands.skills.pick import pick
from mpvi_bt.hands.skills.place import place_in, place_next_to, place_on, place_under
from mpvi_bt.hands.skills.pour import pour
from mpvi_bt.hands.skills.press import press
from mpvi_bt.hands.skills.push import push
from mpvi_bt.hands.skills.set_down import either, set_down
from mpvi_bt.hands.skills.wait import wait
from mpvi_bt.hands.skills.wipe import wipe

REPERTOIRE: Mapping[str, Perform] = {
    "go_to": go_to,
    "open": with_a_free_hand(open_),
    "close": with_a_free_hand(close),
    "press": with_a_free_hand(press),
    "push": with_a_free_hand(push),
    "pick": with_a_free_hand(pick),
    "place_in": place_in,
    "place_on": either(place_on, set_down),
    "place_next_to": place_next_to,
    "place_under": place_under,
    "lift": with_a_free_hand(lift),
    "hand_over": hand_over,
    "pour": pour,
    "cut": cut,
    "dice": dice,
    "spray": spray,
    "light": light,
    "mount": mount,
    "wait": wait,
    "wipe": wipe,
}


def motion_of(skill: Skill) -> Perform | None:
    """The motion that does a skill; None if there is none.

    Raises:
        UserError: Its file names a function that is not there.
    """
    if skill.motion is not None:
        motion: Perform = imported(skill.motion, f"skill {skill.name}: motion")
        return motion
    return REPERTOIRE.get(skill.like or skill.name)
