"""Let go of a held thing: in a container, on a surface, next to or under another thing."""

from __future__ import annotations

import re
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from itertools import chain, islice

import numpy as np

from mpvi_bt.finding.scene.hands import Held
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.motion import Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import Side, other
from mpvi_bt.ground.words.phrases import read
from mpvi_bt.hands.motion.carry import come_out, draw_in, settle
from mpvi_bt.hands.motion.gaze import look_at
from mpvi_bt.hands.motion.work import Words, Work
from mpvi_bt.hands.skills import spots
from mpvi_bt.hands.skills.drop import drop_in, reach_over
from mpvi_bt.hands.skills.inside import looks_inside
from mpvi_bt.hands.skills.pick import from_above, pick_up, slanted_options
from mpvi_bt.hands.skills.placing import LYING, SETTING, SLANTED, UPRIGHT, Pose, place_at, release

Spots = Callable[[Work, Held, str, Sequence[float]], Iterator[Sequence[Pose]]]  # by a thing, for some leans
Groups = Callable[[Held], Iterable[Sequence[Pose]]]  # poses to leave a thing in, those about one place together


_BESIDE = re.compile(r"(?:beside|next to) (?P<what>.+)")
_BARRED = ("no_free_spot", "no_stance")
_UPRIGHT_SPOTS = 4  # our choice: tried with the payload upright before it may lean, at twice as many


def place_in(work: Work, words: Words, tried: list[Array]) -> Actions:
    """Let go of the held `words["object"]` in `words["container"]`, which stands somewhere or hangs in the other hand.

    It falls in from above where the container is open there, and else is set down on a board inside, from the front.
    What falls beside it is picked up and put in once more. What was taken from above, and has no room in there below a
    hand, is set down beside the container and taken from a side.

    Raises:
        MotionFailure: "not_held", "unknown_object", "not_a_container", "no_release", "no_free_spot", "no_stance",
            "not_released", "missed", or a motion's own reason.
    """
    side = work.hand_with(words["object"], words.get("hand"))
    container = work.same(words["container"], ajar=True)
    name = work.load(side).name
    try:
        lies_in = yield from _put_in(work, side, container, tried)
    except MotionFailure as failure:
        if failure.reason not in _BARRED or not from_above(work.hand(side)):
            raise
        if not (yield from _taken_from_a_side(work, side, name, container)):
            raise
        lies_in = yield from _put_in(work, side, container, tried)
    if lies_in:
        return
    if work.scene.holding(side) is None:
        with suppress(MotionFailure):
            yield from pick_up(work, name, side, [])
    if work.scene.holding(side) != name or not (yield from _put_in(work, side, container, tried)):
        raise MotionFailure("missed")


def _taken_from_a_side(work: Work, side: Side, name: str, container: str) -> Generator[Array, None, bool]:
    """Set a payload down beside a container, and take it with a slanted hand; whether that went well."""
    try:
        yield from _place_by(work, side, container, spots.beside, SLANTED, [])
    except MotionFailure:
        return False
    try:
        yield from pick_up(work, name, side, [], slanted_options)
    except MotionFailure:
        with suppress(MotionFailure):
            yield from pick_up(work, name, side, [])
        return False
    return True


def _put_in(work: Work, side: Side, container: str, tried: list[Array]) -> Generator[Array, None, bool]:
    """Let go of what a hand holds in a container; returns whether it came to lie in there. Raises as `place_in`."""
    yield from draw_in(work)
    failure = MotionFailure("not_a_container")
    for look in looks_inside(work, container):
        if not (yield from look) or not work.scene.volumes(container):
            continue
        held = work.load(side)
        try:
            yield from _let_go_in(work, side, container, tried)
        except MotionFailure as barred:  # by what is seen from here
            if barred.reason not in _BARRED:
                raise
            failure = barred
            continue
        lies_in = held.name in work.scene.within(container)
        yield from _come_away(work, held.name, lies_in)
        return lies_in
    raise failure


def _let_go_in(work: Work, side: Side, container: str, tried: list[Array]) -> Actions:
    if work.scene.holding(other(side)) == container:
        yield from reach_over(work, side, container)
        yield from look_at(work, container)
        yield from release(work, side)
    elif not (yield from drop_in(work, side, container, tried)):
        groups = _upright_first(lambda held, leans: spots.on(work, held, container, leans, inside=True), LYING)
        try:
            yield from place_at(work, side, container, groups, tried)
        except MotionFailure as failure:  # nothing can be set down in a jar
            barred = failure.reason in _BARRED
            if not barred or not (yield from drop_in(work, side, container, tried, anywhere=True)):
                raise


def place_on(work: Work, words: Words, tried: list[Array]) -> Actions:
    """Set the held `words["object"]` down on `words["surface"]`, upright, at a free spot; the floor is a surface, too.

    Raises:
        MotionFailure: "not_held", "unknown_object", "no_free_spot", "no_stance", "not_released", "missed", or a
            motion's own reason.
    """
    side = work.hand_with(words["object"], words.get("hand"))
    if spots.is_floor(words["surface"]):
        yield from set_on_floor(work, side, tried)
        return
    yield from _place_by(work, side, work.same(words["surface"]), spots.on, LYING, tried)


def set_on_floor(work: Work, side: Side, tried: list[Array]) -> Actions:
    """Set what a hand holds down on free floor around the robot. Raises as `place_on`."""
    groups = _upright_first(partial(spots.on_floor, work), LYING)
    yield from _place(work, side, None, groups, tried)


def place_next_to(work: Work, words: Words, tried: list[Array]) -> Actions:
    """Set the held `words["object"]` down beside `words["target"]`, on what that stands on.

    Raises:
        MotionFailure: As `place_on`.
    """
    side = work.hand_with(words["object"], words.get("hand"))
    yield from _place_by(work, side, _standing(work, words["target"]), spots.beside, SLANTED, tried)


def place_under(work: Work, words: Words, tried: list[Array]) -> Actions:
    """Set the held `words["object"]` down on the floor below `words["target"]`, beside another thing if that says so.

    Raises:
        MotionFailure: As `place_on`.
    """
    side = work.hand_with(words["object"], words.get("hand"))
    by: str | None = None
    reading = read(words["target"])
    if reading is not None and (said := _BESIDE.match(reading.place)) is not None:
        with suppress(MotionFailure):  # what it names may not be known, or be what is held
            by = work.nearest(said["what"])
        by = None if by in work.carried() else by
    yield from _place_by(work, side, _standing(work, words["target"]), partial(spots.under, by=by), LYING, tried)


def _standing(work: Work, phrase: str) -> str:
    """The nearest thing that a phrase names and that the robot does not carry: nothing is set down beside itself.

    Raises:
        MotionFailure: "unknown_object" if there is none.
    """
    carried = work.carried()
    if not (names := [name for name in work.alike(phrase) if name not in carried]):
        raise MotionFailure("unknown_object")
    return names[0]


def _upright_first(
    groups: Callable[[Held, Sequence[float]], Iterable[Sequence[Pose]]], leans: Sequence[float]
) -> Groups:
    """Poses with the thing upright, then those in which it leans, at the best places of each."""
    return lambda held: chain(
        islice(groups(held, UPRIGHT), _UPRIGHT_SPOTS), islice(groups(held, leans), 2 * _UPRIGHT_SPOTS)
    )


def _place_by(work: Work, side: Side, name: str, at: Spots, leans: Sequence[float], tried: list[Array]) -> Actions:
    """Set down at spots by a thing: on it, next to it, under it."""
    yield from _place(work, side, name, _upright_first(lambda held, some: at(work, held, name, some), leans), tried)


def _place(work: Work, side: Side, about: str | None, groups: Groups, tried: list[Array]) -> Actions:
    """Set down, see whether it stayed where it was to lie, fold the arm."""
    yield from draw_in(work)
    held = work.load(side)
    heights = yield from place_at(work, side, about, groups, tried)
    yield from work.see("head")
    box, _ = spots.size(work.scene.solids(held.name))
    # An arm may hide all but the cap of a bottle: that one lies elsewhere of which neither end is where it was to be.
    missed = bool((np.abs(box[:, 2] - heights) > SETTING.lost_m).all())
    yield from _come_away(work, held.name, not missed)
    if missed:
        raise MotionFailure("missed")


def _come_away(work: Work, name: str, there: bool) -> Actions:
    """Fold once a thing was let go of; if it is `there`, an arm that is caught is no failure: nothing is left to do.

    Raises:
        MotionFailure: As `settle`, if the thing is not where it was to be.
    """
    try:
        yield from settle(work, without={name})
    except MotionFailure:
        if not there:
            raise
        yield from come_out(work)
