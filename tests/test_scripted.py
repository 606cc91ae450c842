"""How a scripted policy goes on with a prompt after one of its skills has failed."""

from __future__ import annotations

import itertools
from collections.abc import Generator
from types import SimpleNamespace
from typing import Any, cast

import pytest

from mpvi_bt.executive.plan.clauses import match
from mpvi_bt.executive.plan.skills import SkillCall, load_skills
from mpvi_bt.finding.scene.scene import Scene
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.motion import Actions, MotionFailure
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.hands.motion.work import Words, Work
from mpvi_bt.hands.policies.scripted_policy import Performance, ScriptedPolicy
from tests.serving import observation

PROMPT = "put the cup on the table with the left hand, then put the bowl on the table with the right hand"


class Told(ScriptedPolicy):
    """Its skills succeed or fail as told, one after the other; it notes what it tried."""

    def __init__(self, outcomes: str) -> None:
        super().__init__(cast("Scene", SimpleNamespace(needs_looks=False)), load_skills())
        self.outcomes, self.objects = list(outcomes), ""

    def _carries(self, work: Work, phrase: str) -> bool:
        return True

    def attempt(self, work: Work, call: SkillCall) -> Any:
        """The next outcome: "+" or "-", and after the last one always "-"."""
        yield from ()
        self.objects += call.arguments["object"][0]
        return bool(self.outcomes) and self.outcomes.pop(0) == "+"


@pytest.mark.parametrize(
    ("outcomes", "objects"),
    [
        ("++", "cb."),
        ("+--+", "cbbb."),  # the cup is on the table, and stays there: the bowl alone is tried again
        ("+-++", "cbb."),
        ("+---", "cbbb"),
        ("-+-+", "ccbb."),  # the cup needed two rounds
        ("---", "cccb"),  # what was never done holds up what comes after it, but for the last time
        ("---+", "cccb"),  # what can be done all the same then is no reason to call it done
    ],
)
def test_a_round_goes_on_after_what_was_put_away_before(outcomes: str, objects: str) -> None:
    """What failed is tried again; another cup is not put on the table for it."""
    assert tried(PROMPT, outcomes) == objects


@pytest.mark.parametrize(
    ("prompt", "content"),
    [
        ("open the cabinet, then pick up a bowl from the cabinet", "bowl"),
        ("open the cabinet, then pick up the bowl from the table", None),
        ("open the cabinet", None),
        ("pick up a cup from the cabinet, then open the cabinet", None),
    ],
)
def test_what_is_opened_is_opened_for_what_is_taken_out_of_it(prompt: str, content: str | None) -> None:
    """The first thing that the same prompt takes from it is what it has to have in it."""
    policy = Opening("++")
    work = cast("Work", SimpleNamespace())
    list(policy.perform(work, prompt))
    assert policy.opened == [content]


class Opening(Told):
    """It notes what was to be in what it opens."""

    def __init__(self, outcomes: str) -> None:
        super().__init__(outcomes)
        self.opened: list[str | None] = []

    def attempt(self, work: Work, call: SkillCall) -> Any:
        """As told."""
        if call.skill.name == "open":
            self.opened.append(call.arguments.get("content"))
        return (yield from super().attempt(work, call))


class Empty(Told):
    """Its hands are empty until it has picked something up."""

    def __init__(self, outcomes: str) -> None:
        super().__init__(outcomes)
        self.skills, self.holds = "", False

    def attempt(self, work: Work, call: SkillCall) -> Any:
        """As told; what fails to be put somewhere slips out."""
        self.skills += f"{call.skill.name} "
        done = yield from super().attempt(work, call)
        self.holds = done and call.skill.name == "pick"
        return done

    def _carries(self, work: Work, phrase: str) -> bool:
        return self.holds

    def _graspable(self, work: Work, phrase: str) -> bool:
        return True


@pytest.mark.parametrize(
    ("outcomes", "skills"),
    [("++", "pick place_on."), ("-++", "pick pick place_on."), ("+-++", "pick place_on pick place_on.")],
)
def test_what_is_to_be_put_somewhere_and_is_not_in_hand_is_picked_up_first(outcomes: str, skills: str) -> None:
    """It may have slipped out on the way, or not have been taken at all."""
    policy = Empty(outcomes)
    done = _returned(policy.perform(cast("Work", None), "put the cup on the table")) is not None
    assert policy.skills.strip() + "." * done == skills


@pytest.mark.parametrize(
    ("outcomes", "objects"),
    [
        ("++-+++", "dcbdcb."),
        ("++---+", "dcbdcb."),  # the door is open and the cup in hand
        ("-+++", "ddcb."),
    ],
)
def test_a_round_begins_anew_where_nothing_was_put_away(outcomes: str, objects: str) -> None:
    """What was taken may have been dropped, what was opened fallen shut."""
    assert tried("open the door, then pick up the cup, then open the bin", outcomes) == objects


def tried(prompt: str, outcomes: str) -> str:
    """The first letters of the objects of what was tried, with a full stop if it was done in the end."""
    policy = Told(outcomes)
    done = _returned(policy.perform(cast("Work", None), prompt)) is not None
    return policy.objects + "." * done


class Fails(ScriptedPolicy):
    """Its one skill fails, after a step in which the robot stays as it is, its head turns, or a look is taken."""

    def __init__(self, changes: str) -> None:
        scene = SimpleNamespace(needs_looks=changes == "view", holding=lambda side: None, between=lambda: "box")
        scene.see = lambda images, felt: None
        super().__init__(cast("Scene", scene), load_skills())
        self._motions = dict.fromkeys(self._motions, self._fail)
        self._changes = changes

    def _fail(self, work: Work, words: Words, tried: list[Array]) -> Actions:
        if self._changes == "head":
            work.motion.action[work.motion.layout.torso][3] += 0.01
        yield from work.see("head")
        yield work.motion.still()
        if self._changes == "base pose":
            tried.append(work.motion.felt.base_pose)
        raise MotionFailure("no_stance", "shelf")

    def _recover(self, work: Work) -> Actions:
        yield work.motion.still()


@pytest.mark.parametrize(("changes", "attempts"), [("nothing", 1), ("view", 2), ("head", 12), ("base pose", 12)])
def test_an_attempt_that_changed_nothing_is_not_repeated_and_takes_time(changes: str, attempts: int) -> None:
    """It would fail alike, and where planning takes long and no time passes no timeout would end that."""
    policy = Fails(changes)
    seen = observation("open the door")
    steps = next(step for step in itertools.count() if policy.infer(seen) is None or policy.ended)
    assert policy.attempts == attempts
    assert steps >= CONTROL_HZ or changes in ("head", "base pose")
    assert policy.note == "open: no_stance (shelf)"


class Gives(ScriptedPolicy):
    """What it is told ends at once: "done" and shown, "lost" and done again, "undone", or a motion that "failed"."""

    def __init__(self, end: str) -> None:
        super().__init__(cast("Scene", SimpleNamespace(needs_looks=False)), load_skills())
        self.end, self.performed = end, 0

    def perform(self, work: Work, prompt: str) -> Performance:
        self.performed += 1
        yield work.motion.still()
        if self.end == "failed":
            raise MotionFailure("no_stance")
        return None if self.end == "undone" else match("pick up the cup", load_skills())

    def _finish(self, work: Work, last: SkillCall) -> Generator[Array, None, bool]:
        yield work.motion.still()
        return self.end == "lost" and self.performed % 2 == 1


@pytest.mark.parametrize(("end", "performed"), [("done", 1), ("lost", 2), ("undone", 1), ("failed", 1)])
def test_it_gives_up_some_time_after_it_has_nothing_more_to_do(end: str, performed: int) -> None:
    """Not before whoever only looks can have been asked; and never what it is told next."""
    policy, seen = Gives(end), observation()
    steps = next(step for step in itertools.count() if policy.infer(seen) is None or policy.gave_up)
    assert policy.ended
    assert policy.performed == performed
    assert 3.0 < steps / CONTROL_HZ < 6.0
    policy.infer({**seen, "prompt": "put the bowl on the table"})
    assert not policy.gave_up
    for _ in range(steps + 1):
        policy.infer({**seen, "prompt": "put the bowl on the table"})
    assert policy.gave_up
    policy.reset()
    assert not policy.gave_up


class Looks(ScriptedPolicy):
    """It looks once with the head, and keeps what pictures it had while it did and while it did not."""

    needs_looks = True

    def __init__(self) -> None:
        super().__init__(cast("Scene", self), load_skills())
        self.seen: list[tuple[str, ...]] = []

    def see(self, images: dict[str, Any], felt: Any) -> None:
        self.seen.append(tuple(images))

    def perform(self, work: Work, prompt: str) -> Performance:
        self.seen.append(tuple(work.images))
        yield from work.see("head")
        self.seen.append(tuple(work.images))
        yield work.motion.still()
        self.seen.append(tuple(work.images))
        return None


def test_it_has_the_pictures_that_it_asked_for_and_no_others() -> None:
    """Whatever was sent: with more of them it must not go another way."""
    policy = Looks()
    for _ in range(3):
        policy.infer(observation())
    assert policy.seen == [(), ("head",), ("head",), ()]


def _returned(performance: Performance) -> SkillCall | None:
    """What it returns at its end."""
    while True:
        try:
            next(performance)
        except StopIteration as end:
            return cast("SkillCall | None", end.value)


def test_what_it_is_doing_ends_when_it_is_closed_and_not_after_its_world() -> None:
    """A pick that was cut short asks the hand what it holds: of a simulator that is gone nothing can be asked."""
    ended = []

    class Holds(Told):
        def attempt(self, work: Work, call: SkillCall) -> Any:
            try:
                while True:
                    yield work.motion.still()
            finally:
                ended.append(call.skill)

    policy = Holds("")
    policy.infer(observation(PROMPT))
    assert not ended
    policy.close()
    assert len(ended) == 1
