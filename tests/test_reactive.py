"""The reactive policy: what it knows is what it has seen."""

from __future__ import annotations

import inspect
from collections.abc import Generator, Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest

from mpvi_bt.executive.plan.clauses import match
from mpvi_bt.executive.plan.knowledge import Entry, KnowledgeBase
from mpvi_bt.executive.plan.skills import SkillCall, load_skills
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.motion import Motion
from mpvi_bt.ground.robot.protocol import CONTROL_HZ, SIDES
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.policies import reactive as module
from mpvi_bt.hands.policies.reactive import ReactivePolicy
from mpvi_bt.hands.skills.open import is_open
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.states.relations import inside, ontop
from mpvi_bt.testing import KinematicRobot, check_policy
from tests.layouts import BASE, CAMERAS, LAYOUT
from tests.small_house import placed, small_world

SKILLS = load_skills()
TABLE = "{entry: table, at: [1.0, 0.0]}"
VOCABULARY = {"can": ("can of soda",), "bin": ("trash can",), "table_1": ("table",)}


def reactive(seed: int = 0) -> ReactivePolicy:
    return ReactivePolicy(SKILLS, seed, vocabulary=VOCABULARY)


@dataclass
class Played:
    """What came of a prompt."""

    note: str = ""
    pictures: int = 0
    actions: list[Array] = field(default_factory=list)


def play(world: SimWorld, policy: ReactivePolicy, prompt: str, limit_s: float, every: bool = False) -> Played:
    """Have the policy follow a prompt until its note is "done", or for `limit_s`; show it `every` picture there is."""
    played = Played()
    for _ in range(round(limit_s * CONTROL_HZ)):
        images = {camera: world.robot.look(camera) for camera in (CAMERAS if every else policy.cameras)}
        played.pictures += len(images)
        felt = world.robot.proprioception()
        (action,) = policy.infer({"prompt": prompt, "proprioception": felt, "images": images})
        world.robot.act(action)
        world.step()
        played.actions.append(action)
        if policy.note == "done":
            break
    played.note = policy.note
    world.refresh()
    return played


def calm(world: SimWorld) -> SimWorld:
    world.settle()
    return world


def test_it_is_given_no_world() -> None:
    """Its constructor takes skills, a seed, a timer, a detector, words, and what who drove here has seen to stand.

    Nothing that could answer for the truth: what stands is the navigator's map, which is made of pictures, too.
    """
    parameters = inspect.signature(ReactivePolicy).parameters
    assert list(parameters) == ["skills", "seed", "timer", "detector", "vocabulary", "standing"]


@pytest.mark.render
@pytest.mark.parametrize("prompt", ["pick up the can of soda", "sing a song", "", "pick up the elephant"])
def test_it_keeps_the_policys_contract(prompt: str) -> None:
    """It passes the check that every policy passes, whatever it is told."""
    world = calm(small_world({"can": placed("can_of_soda", 1.0, 0.0)}, render=True))
    images = {camera: world.robot.look(camera) for camera in ("head", *SIDES)}
    felt = world.robot.proprioception()
    observation: Mapping[str, object] = {"prompt": prompt, "proprioception": felt, "images": images}
    check_policy(reactive(), observation)


@pytest.mark.render
def test_what_moves_unseen_changes_nothing_until_it_is_seen() -> None:
    """Worlds that differ only in where an unseen thing is give the same actions until a picture shows it."""
    runs = []
    for y in (0.0, 0.6):
        world = calm(small_world({"can": placed("can_of_soda", -1.5, y)}, render=True))
        runs.append(np.stack(play(world, reactive(3), "pick up the can of soda", 5.0).actions))
    np.testing.assert_array_equal(runs[0], runs[1])


@pytest.mark.render
def test_the_same_observations_give_the_same_actions() -> None:
    """Two policies of one seed in worlds that are alike do alike, number for number."""

    def actions() -> Array:
        world = calm(small_world({"can": placed("can_of_soda", 0.9, 0.2)}, render=True))
        return np.stack(play(world, reactive(3), "pick up the can of soda", 4.0).actions)

    np.testing.assert_array_equal(actions(), actions())


@pytest.mark.render
def test_pictures_that_it_did_not_ask_for_change_nothing() -> None:
    """Somebody may send them all, such as a client that does not heed what is asked for."""

    def actions(every: bool) -> Array:
        world = calm(small_world({"can": placed("can_of_soda", 0.9, 0.2)}, render=True))
        return np.stack(play(world, reactive(3), "pick up the can of soda", 4.0, every).actions)

    np.testing.assert_array_equal(actions(every=False), actions(every=True))


@pytest.mark.render
def test_it_asks_for_pictures_only_when_it_looks() -> None:
    """Most steps need no picture: rendering is what costs."""
    world = calm(small_world({"can": placed("can_of_soda", 0.9, 0.2)}, render=True))
    played = play(world, reactive(), "pick up the can of soda", 6.0)
    assert 1 <= played.pictures <= 0.05 * len(played.actions)


@pytest.mark.render
def test_an_unknown_skill_is_said_and_nothing_moves() -> None:
    """What no skill's phrase fits is left alone, with a note."""
    world = calm(small_world({"can": placed("can_of_soda", 0.9, 0.2)}, render=True))
    played = play(world, reactive(), "sing a song", 1.0)
    assert "no skill" in played.note
    assert np.linalg.norm(world.robot.proprioception().base_pose[:2]) < 0.01


@pytest.mark.render
def test_a_bin_that_two_clauses_mean_is_one_thing() -> None:
    """What is put into the bin without a can lies in the bin without an egg, too: it is no other bin."""
    world = calm(small_world({"bin": placed("trash_can", 1.0, 0.0), "can": placed("can_of_soda", 0.9, 0.4)},
                             render=True))  # fmt: skip
    policy = reactive()
    play(world, policy, "put the can of soda in the trash can without a can, then lift the trash can without an egg", 2)
    assert [e.name for e in policy._seen.knowledge().find("trash can without an egg")] == ["trash can 1"]
    assert len(list(policy._seen.knowledge())) == 2


@pytest.mark.slow
@pytest.mark.render
@pytest.mark.parametrize("at", [(0.9, 0.1), (0.7, -0.6), (-0.9, 0.2)])
def test_a_can_is_picked_up_from_the_floor(at: tuple[float, float]) -> None:
    """It finds the can, behind it too, and takes it."""
    world = calm(small_world({"can": placed("can_of_soda", *at)}, render=True))
    assert play(world, reactive(), "pick up the can of soda", 90.0).note == "done"
    assert "can" in [world.holding(s) for s in SIDES]
    assert world.pose("can")[2, 3] > 0.3


@pytest.mark.slow
@pytest.mark.render
def test_a_clause_that_wants_a_thing_in_hand_has_it_picked_up_first() -> None:
    """Told only to put the can into the bin it picks it up and does so; the hands end up empty."""
    world = calm(small_world({"can": placed("can_of_soda", 0.9, 0.4), "bin": placed("trash_can", 0.9, -0.6)},
                             render=True))  # fmt: skip
    assert play(world, reactive(), "put the can of soda in the trash can", 120.0).note == "done"
    assert inside(world, "can", "bin")
    assert [world.holding(s) for s in SIDES] == [None, None]


@pytest.mark.rare
@pytest.mark.slow
@pytest.mark.render
def test_a_fridge_in_a_corner_is_opened() -> None:
    """The wall beside it is out of view where its door is looked at; the base is not led into that."""
    fridge = "{entry: refrigerator, at: [-2.49, -2.625], yaw_deg: 90}"
    world = calm(small_world(base=(-2.0, -1.2, -1.57), render=True, fridge=fridge))
    policy = ReactivePolicy(SKILLS, vocabulary={"fridge": ("fridge",)})
    assert play(world, policy, "open the fridge", limit_s=60.0).note == "done"
    assert policy.attempts == 1
    assert is_open(world.doors("fridge")[0])


@pytest.mark.rare
@pytest.mark.slow
@pytest.mark.render
def test_a_can_is_set_down_on_a_table() -> None:
    """From the floor to the table, standing."""
    world = calm(small_world({"can": placed("can_of_soda", 0.2, 0.9)}, render=True, table_1=TABLE))
    prompt = "pick up the can of soda, then put the can of soda on the table"
    assert play(world, reactive(), prompt, 150.0).note == "done"
    assert ontop(world, "can", "table_1")


@pytest.mark.slow
@pytest.mark.render
def test_who_is_done_looks_at_what_it_did() -> None:
    """Until somebody says that it is complete: a robot that stands still is asked about its head's picture."""
    world = calm(small_world({"can": placed("can_of_soda", 0.2, 0.9), "bin": placed("trash_can", 1.0, 0.3)},
                             render=True))  # fmt: skip
    policy, prompt = reactive(), "put the can of soda on the floor next to the trash can"
    assert play(world, policy, prompt, 150.0).note == "done"
    for _ in range(2 * CONTROL_HZ):
        images = {camera: world.robot.look(camera) for camera in policy.cameras}
        (action,) = policy.infer({"prompt": prompt, "proprioception": world.robot.proprioception(), "images": images})
        world.robot.act(action)
        world.step()
    seen = world.robot.look("head")
    assert seen.labels is not None
    assert {"can", "bin"} <= {seen.names.get(int(label)) for label in np.unique(seen.labels)}


class Stuck(KinematicRobot):
    """A robot whose torso, base or arms do not follow."""

    def __init__(self, part: str) -> None:
        super().__init__()
        self._part = part

    def advance(self, action: Array) -> None:
        """Leave out what concerns the part."""
        parts = {"base": [BASE], "torso": [LAYOUT.torso], "arms": list(LAYOUT.arm.values())}
        kept, action = self._targets, action.copy()
        for part in parts[self._part]:
            action[part] = kept[part]
        super().advance(action)


@pytest.mark.parametrize("part", ["torso", "base", "arms"])
def test_a_robot_that_does_not_follow_makes_it_fail_not_crash(part: str) -> None:
    """Where a motion does not succeed it goes on with another, or stands still with a note; infer never raises."""
    robot, policy = Stuck(part), reactive()
    for _ in range(1500):
        images = {camera: robot.look(camera) for camera in policy.cameras}
        observation = {"prompt": "pick up the cup", "proprioception": robot.proprioception(), "images": images}
        (action,) = policy.infer(observation)
        robot.advance(action)
    assert policy.note


def knowing_sandals(monkeypatch: pytest.MonkeyPatch, known: int) -> ReactivePolicy:
    """A policy that knows so many sandals, the first of them in its hand."""
    base = KnowledgeBase()
    for k in range(known):
        base.put(Entry(f"sandal {k}", ("sandal",), "object", np.zeros(3), np.ones(3), held=k == 0))
    policy = reactive()
    monkeypatch.setattr(policy._seen, "knowledge", lambda: base)
    return policy


@pytest.mark.parametrize("known", [1, 2])
@pytest.mark.parametrize("where", ["next to", "on"])
def test_a_thing_beside_which_another_goes_is_looked_for(
    monkeypatch: pytest.MonkeyPatch, known: int, where: str
) -> None:
    """What is in hand is not "the other sandal", by which it is to be put, though it is called so."""
    policy = knowing_sandals(monkeypatch, known)
    call = match(f"put the sandal {where} the other sandal", SKILLS)
    assert call is not None
    assert (policy._grounded(call) is not None) is (known == 2)


@pytest.mark.parametrize("known", [1, 2])
def test_a_hand_does_not_take_what_the_other_one_has(monkeypatch: pytest.MonkeyPatch, known: int) -> None:
    """The sandal that the right hand is to take is none that the left one holds: another one is looked for."""
    policy = knowing_sandals(monkeypatch, known)
    monkeypatch.setattr(policy._seen, "holding", lambda side: "sandal 0" if side == "left" else None)
    right, left = (match(f"pick up the other sandal with the {side} hand", SKILLS) for side in ("right", "left"))
    assert right is not None
    assert left is not None
    assert (policy._grounded(right) is not None) is (known == 2)
    assert policy._grounded(left) is not None


@pytest.mark.parametrize("holder", ["near", "middle", "far", None])
def test_what_is_not_in_the_thing_that_was_opened_is_looked_for_in_the_next(
    monkeypatch: pytest.MonkeyPatch, holder: str | None
) -> None:
    """Which cabinet is the one with a jar is seen once it stands open: they are opened in turn, the nearest first."""
    policy, known, opened = reactive(), KnowledgeBase(), list[str]()
    for k, name in enumerate(("near", "middle", "far")):
        known.put(Entry(name, ("cabinet",), "fixture", np.full(3, float(k)), np.full(3, k + 0.5)))
    work = Work(policy._seen, Motion(KinematicRobot().proprioception()), np.random.default_rng(0))
    monkeypatch.setattr(policy._seen, "knowledge", lambda: known)
    monkeypatch.setattr(policy._seen, "within", lambda name: [])
    monkeypatch.setattr(Work, "stands_open", lambda self, name: name in opened)

    def do(work: Work, call: SkillCall) -> Generator[Array, None, bool]:
        yield from ()
        if call.skill.name == "open":
            opened.append(work.nearest(call.arguments["object"]))
            if opened[-1] == holder:
                known.put(Entry("jar", ("jar",), "object", np.zeros(3), np.ones(3), inside=holder))
        return True

    def nothing(*_: object) -> Generator[Array, None, bool]:
        yield from ()
        return False

    monkeypatch.setattr(policy, "do", do)
    monkeypatch.setattr(module, "stand_before_open", nothing)
    monkeypatch.setattr(module, "look_for", nothing)
    assert not list(policy.perform(work, "open the cabinet with a jar, then pick up a jar"))
    order = ["near", "middle", "far"]
    assert opened == (order[: order.index(holder) + 1] if holder else order)
