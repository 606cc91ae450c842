"""Letting go of things: what is done about one that falls beside its container."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from mpvi_bt.finding.scene.hands import Held
from mpvi_bt.finding.scene.scene import Scene
from mpvi_bt.finding.shapes.from_above import outline
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array, box, pose
from mpvi_bt.ground.robot.collision import Load, Surroundings
from mpvi_bt.ground.robot.motion import Actions, Motion, MotionFailure
from mpvi_bt.ground.robot.protocol import Proprioception, Side
from mpvi_bt.hands.motion import approach
from mpvi_bt.hands.motion.work import Work
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.hands.skills import drop, place, placing
from mpvi_bt.hands.skills.placing import leaning
from mpvi_bt.hands.stance.effort import Effort
from mpvi_bt.hands.stance.stance import Option
from mpvi_bt.hands.stance.stance_search import Search
from mpvi_bt.house.sim.world import SimWorld
from mpvi_bt.house.truth.true_scene import TrueScene
from mpvi_bt.testing import SceneBuilder
from mpvi_bt.testing.full_hands import put_in_hands
from tests.small_house import placed, small_world
from tests.test_motion import obey, play, reaching

EGG = {"object": "Easter egg", "container": "mixing bowl"}
ON_THE_FLOOR = pose((0.6, 0.5, 0.02))


def at_work(world: SimWorld) -> Work:
    """A skill's view of a world that stands still, known by truth."""
    return Work(TrueScene(world), Motion(world.robot.proprioception()), np.random.default_rng(0))


def egg_in_hand() -> SimWorld:
    """The left hand holds an egg, a bowl is within reach."""
    scene = SceneBuilder().thing("bowl", "mixing_bowl", (0.6, 0.0, 0.0)).thing("egg", "easter_egg")
    return scene.in_hand("left", "egg").world()


def let_fall(world: SimWorld, inside: bool) -> None:
    """Have the egg lie in the bowl, or beside it."""
    world.place("egg", world.pose("bowl") @ pose((0.0, 0.0, 0.03)) if inside else ON_THE_FLOOR)


def nothing(*_: object, **__: object) -> Actions:
    """Stands in for a motion of which nothing is to be seen here."""
    yield from ()


@pytest.mark.parametrize(
    ("falls_in", "reachable", "done"),
    [
        ([True], True, "drop"),
        ([False, True], True, "drop pick drop"),
        ([False, False], True, "drop pick drop missed"),
        ([False], False, "drop pick missed"),
    ],
)
def test_what_falls_beside_its_container_is_put_in_once_more(
    monkeypatch: pytest.MonkeyPatch, falls_in: list[bool], reachable: bool, done: str
) -> None:
    """It is picked up where it lies and let go of again; what stays beside it, or out of reach, was missed."""
    world = egg_in_hand()
    work, log, falls = at_work(world), [], iter(falls_in)

    def drop_in(work: Work, side: Side, container: str, tried: list[Array]) -> Generator[Array, None, bool]:
        log.append("drop")
        let_fall(world, next(falls))
        yield from ()
        return True

    def pick_up(work: Work, name: str, side: Side, tried: list[Array]) -> Actions:
        log.append("pick")
        yield from ()
        if not reachable:
            raise MotionFailure("no_stance")
        put_in_hands(world, {side: name})

    for name, stand_in in (("drop_in", drop_in), ("pick_up", pick_up), ("settle", nothing), ("draw_in", nothing)):
        monkeypatch.setattr(place, name, stand_in)
    try:
        list(place.place_in(work, EGG, []))
    except MotionFailure as failure:
        log.append(failure.reason)
    assert " ".join(log) == done


@pytest.mark.parametrize("falls_in", [True, False])
def test_an_arm_that_is_caught_after_it_has_let_go_fails_only_what_did_not_get_there(
    monkeypatch: pytest.MonkeyPatch, falls_in: bool
) -> None:
    """To try again with nothing in hand would end the prompt, and the cabinet would stay open."""
    world = egg_in_hand()
    work, came_out = at_work(world), []

    def drop_in(*_: object) -> Generator[Array, None, bool]:
        let_fall(world, falls_in)
        yield from ()
        return True

    def caught(*_: object, **__: object) -> Actions:
        yield from ()
        raise MotionFailure("arm_blocked")

    def come_out(work: Work) -> Actions:
        came_out.append(work)
        yield from ()

    for name, stand_in in (("drop_in", drop_in), ("settle", caught), ("come_out", come_out)):
        monkeypatch.setattr(place, name, stand_in)
    with nullcontext() if falls_in else pytest.raises(MotionFailure, match="arm_blocked"):
        list(place.place_in(work, EGG, []))
    assert bool(came_out) is falls_in


def test_what_slips_out_just_before_it_is_put_in_is_not_held(monkeypatch: pytest.MonkeyPatch) -> None:
    """It may fall while the hand is brought before the body: that is a failure with its reason, no other error."""
    world = egg_in_hand()
    work = at_work(world)

    def draw_in(work: Work) -> Actions:
        let_fall(world, inside=False)
        yield from ()

    monkeypatch.setattr(place, "draw_in", draw_in)
    with pytest.raises(MotionFailure, match="not_held"):
        list(place.place_in(work, EGG, []))


def test_the_shelf_is_the_same_shelf_again() -> None:
    """Of two side by side what a phrase meant first it means from wherever both are near; "another" is the other."""
    world = small_world(
        {},
        shelf_1="{entry: shelf, at: [1.0, 0.5], yaw_deg: 180}",
        shelf_2="{entry: shelf, at: [1.0, -0.5], yaw_deg: 180}",
    )
    felt = world.robot.proprioception()

    def there(y: float, meant: dict[str, str]) -> Work:
        motion = Motion(replace(felt, base_pose=np.array([0.0, y, 0.0])))
        return Work(TrueScene(world), motion, np.random.default_rng(0), meant=meant)

    meant: dict[str, str] = {}
    assert there(0.3, meant).same("the shelf") == "shelf_1"
    assert there(-0.3, meant).same("the shelf") == "shelf_1"
    assert there(-0.3, {}).same("the shelf") == "shelf_2"
    assert there(0.3, meant).same("the other shelf") == "shelf_2"
    far = {"shelf": "shelf_1"}
    assert there(-3.0, far).same("the shelf") == "shelf_2"


@pytest.mark.parametrize("yaw", [0.0, 0.25])
def test_a_hand_keeps_clear_of_the_lid_of_what_it_lets_something_fall_into(
    monkeypatch: pytest.MonkeyPatch, yaw: float
) -> None:
    """Straight from above the palm would meet a lid that stands upright at the rim of a jar; it is tilted off that."""
    world = small_world({"jar": placed("hinged_jar", 0.7, 0.1, yaw=yaw), "sausage": placed("bratwurst", 1.5, 1.5)})
    world.set_opening("jar", "lid", 1.5 / 1.9)
    work = at_work(world)
    motion = work.motion
    down = kin.transform(kin.hand_rotation(np.array([0.0, 0.0, -1.0]), np.array([0.0, 1.0, 0.0])), (0.5, -0.2, 0.7))
    q = motion.robot.nearest_posture(kin.inverse(motion.robot.chest(motion.torso)) @ down, "right", motion.arm("right"))
    assert q is not None
    motion.felt.arm["right"][:] = q
    T_tcp_thing = kin.inverse(kin.transform(down[:3, :3], (0.0, 0.0, 0.0))) @ kin.transform(
        np.eye(3), (0.0, 0.0, -0.01)
    )
    frame = T_tcp_thing @ kin.inverse(world.pose("sausage"))
    solids = tuple(s.moved(frame) for s in world.solids("sausage"))
    held = Held("sausage", "right", T_tcp_thing, solids, Load(solids))
    clear: list[int] = []
    heights: set[float] = set()

    def find(search: Search, focus: Array, options: Sequence[Option], here_first: bool) -> None:
        clear.append(sum(search.fits(option) for option in options))
        heights.update(round(float(option.waypoints[1][2, 3]), 2) for option in options)

    monkeypatch.setattr(Search, "find", find)
    monkeypatch.setattr(work, "load", lambda side: held)
    assert not list(drop.drop_in(work, "right", "jar", [], anywhere=True))
    assert clear == [80]
    assert max(heights) - min(heights) > 0.05  # well above the lid, too


@pytest.mark.parametrize(
    ("about", "poses", "tries", "went", "reason"),
    [
        ("sofa", 1, 1, 0, "there"),
        ("sofa", 1, 3, 2, "there"),
        ("sofa", 1, 9, 2, "no_stance"),
        ("sofa", 0, 9, 0, "no_free_spot"),
        (None, 1, 9, 0, "no_stance"),
    ],
)
def test_what_cannot_be_set_down_from_here_is_set_down_from_elsewhere(
    monkeypatch: pytest.MonkeyPatch, about: str | None, poses: int, tries: int, went: int, reason: str
) -> None:
    """The robot goes around what it is to be set down on, twice at most, if there is room on it at all."""
    tried, around = [], []

    def close_in(
        work: Work, side: Side, touched: object, about: str | None, find: Callable[..., object], bases: list[Array]
    ) -> Actions:
        tried.append(about)
        find(SimpleNamespace(find=lambda *args: None, effort=Effort()), False)
        yield from ()
        raise MotionFailure("no_stance" if len(tried) < tries else "there")

    def go_around(work: Work, place: Array, been: list[Array]) -> Generator[Array, None, bool]:
        around.append(place.tolist())
        yield from ()
        return True

    monkeypatch.setattr(placing, "close_in", close_in)
    monkeypatch.setattr(approach, "go_around", go_around)
    monkeypatch.setattr(placing, "_options", lambda *args: [None])
    motion = SimpleNamespace(felt=SimpleNamespace(gripper_width={"left": 0.05}), robot=R1)
    said = SimpleNamespace(load=lambda side: SimpleNamespace(name="jar"), motion=motion)
    said.middle = lambda name: np.array({"sofa": (1.0, 2.0, 0.4)}[name])
    said.no_free_spot = lambda payload, place: MotionFailure("no_free_spot", f"{payload}, {place}")
    work = cast("Work", said)
    groups = [[placing.Pose(np.eye(4), 0.0)]] * poses
    with pytest.raises(MotionFailure, match=reason):
        list(placing.place_at(work, "left", about, lambda held: groups, []))
    assert around == [[1.0, 2.0]] * went


@pytest.mark.parametrize(("filled_m", "low", "raised"), [(0.0, True, True), (0.1, False, True), (0.13, False, False)])
def test_a_thing_is_let_go_of_over_a_heap_where_there_is_nowhere_else(
    monkeypatch: pytest.MonkeyPatch, filled_m: float, low: bool, raised: bool
) -> None:
    """An egg falls into an empty bowl of 12 cm; onto a heap below its rim only if asked to; onto a higher one never."""
    world = small_world({"bowl": placed("mixing_bowl", 0.6, 0.0), "egg": placed("easter_egg", 1.5, 1.5, 0.02)})
    work = at_work(world)
    x, y = world.pose("bowl")[:2, 3].tolist()
    heap = box((x, y, filled_m / 2), (0.3, 0.3, filled_m + 1e-3))
    monkeypatch.setattr(work.scene, "within", lambda name: ["heap"])
    monkeypatch.setattr(work.scene, "solids", lambda name: [heap] if name == "heap" else world.solids(name))
    frame = kin.inverse(world.pose("egg"))
    solids = tuple(s.moved(frame) for s in world.solids("egg"))
    held = Held("egg", "right", np.eye(4), solids, Load(solids))
    assert bool(drop.releases(work, held, "left", "bowl")) == low
    assert bool(drop.releases(work, held, "left", "bowl", raised=True)) == raised


@pytest.mark.parametrize("taken", [True, False])
def test_a_bottle_that_was_tipped_on_its_way_is_still_known_to_have_stood(taken: bool) -> None:
    """Upright is as it was when a hand took it, but turned about the vertical as now; unknown, what is nearest."""
    world = small_world({"bottle": placed("bottle_of_olive_oil", 1.5, 1.5)})
    work = at_work(world)
    standing = world.pose("bottle")[:3, :3]
    tipped = kin.rot_z(0.7) @ kin.rot_x(1.2) @ standing
    solids = tuple(world.solids("bottle"))
    held = Held("bottle", "left", kin.transform(kin.rot_y(0.3), (0.0, 0.0, 0.1)), solids, Load(solids))
    if taken:
        work.grasped["left"] = standing @ held.T_tcp_thing[:3, :3].T
    world.place("bottle", kin.transform(tipped, (1.5, 1.5, 0.5)), fixed=True)
    upright = leaning(work, held, 0.0)
    assert upright is not None
    assert (np.abs(upright[:, 2] - [0, 0, 1]).max() < 1e-6) == taken
    assert np.abs(np.abs(upright[2]).max() - 1) < 1e-6
    if taken:
        turned = upright @ standing.T
        assert np.arctan2(turned[1, 0], turned[0, 0]) == pytest.approx(0.7, abs=0.01)


@pytest.mark.parametrize(
    ("at", "turn", "onto"),
    [
        ((0.0, 0.0), 0.0, 0.03),  # on it
        ((0.04, 0.0), 0.0, -0.05),  # beside it, as near as to a wall
        ((0.02, 0.0), 0.0, 0.03),  # it would brush it
        ((0.05, 0.0), np.pi / 2, 0.03),  # its end is over it
        ((0.1, 0.0), np.pi / 2, -0.05),
        ((0.0, 0.1), 0.0, -0.05),
    ],
)
def test_a_pen_falls_onto_what_lies_below_its_outline(at: tuple[float, float], turn: float, onto: float) -> None:
    """As high as a peg of 2 cm reaches where the pen, 14 cm long, is over it; to the bottom where it is beside it."""
    peg = np.array([[-0.01, -0.01, -0.05], [0.01, 0.01, 0.03]])
    pen = outline([box((*at, 0.0), (0.02, 0.14, 0.02), yaw=turn)])
    assert drop._onto(pen[None], [peg], -0.05) == pytest.approx(onto)
    ring = np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]])  # what is under the middle of it
    assert drop._onto(ring[None], [peg], -0.05) == pytest.approx(0.03)


@pytest.mark.parametrize("room", [True, False])
def test_what_cannot_fall_in_from_the_best_places_is_set_down_before_it_falls_from_others(
    monkeypatch: pytest.MonkeyPatch, room: bool
) -> None:
    """A bowl that fell in from the edge of a sink lay beside it; in a jar there is no room to set anything down."""
    scene = SceneBuilder().thing("jar", "hinged_jar", (0.7, 0.1, 0.0)).thing("sausage", "bratwurst")
    world = scene.in_hand("right", "sausage").world()
    work, done = at_work(world), list[str]()

    def into_jar() -> None:
        world.place("sausage", world.pose("jar") @ pose((0.0, 0.0, 0.05)))

    def drop_in(*_: object, anywhere: bool = False) -> Generator[Array, None, bool]:
        done.append("anywhere" if anywhere else "best")
        if anywhere:
            into_jar()
        yield from ()
        return anywhere

    def place_at(*_: object) -> Actions:
        done.append("set down")
        if not room:
            raise MotionFailure("no_free_spot")
        into_jar()
        yield from ()

    for name, stand_in in (("drop_in", drop_in), ("place_at", place_at), ("settle", nothing), ("draw_in", nothing)):
        monkeypatch.setattr(place, name, stand_in)
    list(place.place_in(work, {"object": "bratwurst", "container": "jar"}, []))
    assert done == (["best", "set down"] if room else ["best", "set down", "anywhere"])


def test_what_is_set_down_is_as_the_last_look_has_shown_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is round may be known in a frame that the next picture has turned: no hand turns for that."""
    world = small_world({"egg": placed("easter_egg", 0.6, 0.5, 0.02)})
    work = at_work(world)
    solids = tuple(world.solids("egg"))
    looks = [
        Held("egg", "right", kin.transform(kin.rot_z(turn), (0.0, 0.0, 0.0)), solids, Load(solids))
        for turn in (0.0, 1.9)
    ]
    asked: list[Held] = []

    def close_in(*given: object) -> Actions:
        find = given[4]
        for held in looks:
            monkeypatch.setattr(work, "load", lambda side, held=held: held)
            assert callable(find)
            find(None, False)
        yield from ()
        raise MotionFailure("no_stance")

    def groups(held: Held) -> list[list[placing.Pose]]:
        asked.append(held)
        return []

    monkeypatch.setattr(work, "load", lambda side: looks[0])
    monkeypatch.setattr(placing, "close_in", close_in)
    with pytest.raises(MotionFailure, match="no_free_spot"):
        list(placing.place_at(work, "right", None, groups, []))
    assert asked == looks


@pytest.mark.parametrize("roof_m", [0.26, 0.46])
def test_a_hand_that_points_down_gets_out_from_below_a_board(roof_m: float) -> None:
    """It slides past what stands between its fingers, level, where drawing it back along them would raise it."""
    world = small_world({"egg": placed("easter_egg", 0.6, 0.5, 0.02)})
    down = kin.hand_rotation(np.array([0.0, 0.0, -1.0]), np.array([0.0, 1.0, 0.0]))
    T_tcp_thing = kin.inverse(kin.transform(down, (0.0, 0.0, 0.03)))
    solids = (box((0.0, 0.0, 0.0), (0.05, 0.05, 0.11)).moved(T_tcp_thing),)
    held = Held("egg", "right", T_tcp_thing, solids, Load(solids))
    roof = box((0.6, 0.0, roof_m), (0.3, 0.6, 0.02))
    motion = Motion(world.robot.proprioception())
    search = Search(motion, "right", {"right": held}, Surroundings([roof]), [], np.random.default_rng(0))
    pose = placing.Pose(kin.transform(np.eye(3), (0.6, 0.0, 0.06)), 0.0)
    options = list(placing._options(R1.hand, held, pose, 0.05))
    level = [option for option in options if abs(float(np.ptp(option.waypoints[1:, 2, 3]))) < 1e-9]
    for option in level:  # across the axis that the fingers close along
        assert float((option.waypoints[2] - option.waypoints[1])[:3, 3] @ option.waypoints[1, :3, 1]) == pytest.approx(
            0.0
        )
    free = [option for option in options if search.fits(option)]
    assert free
    assert all(option in level for option in free) == (roof_m < 0.3)


@pytest.mark.parametrize(("length_m", "slides"), [(0.1, False), (0.2, False), (0.4, True)])
def test_fingers_do_not_slide_into_the_corner_of_what_they_let_go_of(length_m: float, slides: bool) -> None:
    """One finger is within a box and would take it along by its end, unless the wall between them is long enough."""
    wall = box((0.0, 0.0, 0.0), (length_m, 0.004, 0.08))
    ends = [box((x, -0.06, 0.0), (0.004, 0.12, 0.08)) for x in (-length_m / 2, length_m / 2)]
    for solids, past in (((wall,), True), ((wall, *ends), slides)):
        held = Held("tupperware", "right", np.eye(4), solids, Load(solids))
        assert placing._slides_past(R1.hand, held, np.array([1.0, 0.0, 0.0]), 0.05) is past


@pytest.mark.parametrize("jammed_m", [0.01, 1.0])
def test_fingers_that_do_not_open_where_they_stand_are_raised(jammed_m: float) -> None:
    """Pressed on the floor they do not slide apart: a little above it they let go, or it is said that they do not."""
    motion = reaching("right")
    motion.felt = replace(motion.felt, gripper_width={"left": 0.1, "right": 0.05})
    work = Work(cast("Scene", None), motion, np.random.default_rng(0))
    began = float(motion.hand("right")[2, 3])

    def step(felt: Proprioception, action: Array) -> Proprioception:
        moved = obey(felt, action)
        free = R1.tcp(moved.torso, moved.arm["right"], "right")[2, 3] > began + jammed_m
        return replace(moved, gripper_width={"left": 0.1, "right": 0.1 if free else 0.05})

    if jammed_m < 0.1:
        play(motion, placing.release(work, "right", 0.08, 0.1), step)
        assert motion.felt.gripper_width["right"] == 0.1
    else:
        with pytest.raises(MotionFailure, match="not_released"):
            play(motion, placing.release(work, "right", 0.08, 0.1), step)


@pytest.mark.parametrize(("reaches_m", "rises_m"), [(0.2, 0.1), (0.06, 0.05), (0.03, 0.025), (0.01, None)])
def test_a_hand_is_raised_as_far_as_its_arm_reaches(
    monkeypatch: pytest.MonkeyPatch, reaches_m: float, rises_m: float | None
) -> None:
    """By 10 cm, or half or a quarter of that; where even that is out of reach it says so."""
    world = small_world()
    work = at_work(world)
    z, went = work.motion.hand("left")[2, 3], []

    def line(side: Side, T: Array) -> Actions:
        if T[2, 3] - z > reaches_m:
            raise MotionFailure("no_reach")
        went.append(float(T[2, 3] - z))
        yield from ()

    monkeypatch.setattr(work.motion, "line", line)
    if rises_m is None:
        with pytest.raises(MotionFailure, match="no_reach"):
            list(work.rise("left"))
    else:
        list(work.rise("left"))
        assert went == [pytest.approx(rises_m)]


@pytest.mark.parametrize(("aside_m", "over"), [(0.0, True), (0.06, True), (0.2, False), (0.6, False)])
def test_a_hand_is_over_a_bin_where_what_it_holds_is_clear_of_its_rim(aside_m: float, over: bool) -> None:
    """However far the bin was pushed from where it stood."""
    world = small_world({"bin": placed("trash_can", 2.0, 0.0), "can": placed("can_of_soda", 3.0, 0.0)})
    put_in_hands(world, {"left": "can"})
    work = at_work(world)
    at = world.pose("bin")
    at[:2, 3] = world.pose("can")[:2, 3] + [aside_m, 0.0]
    world.place("bin", at)
    assert drop._above(work, "left", "bin") is over


@pytest.mark.parametrize(("above", "times"), [((True,), 1), ((False, True), 2), ((False, False), 2)])
def test_what_has_fallen_in_is_in_though_the_hand_does_not_come_up(
    monkeypatch: pytest.MonkeyPatch, above: tuple[bool, ...], times: int
) -> None:
    """A hand at the end of its arm over a toolbox had let the hammer fall, and was told to put it in again.

    One that had pushed the toolbox on its way let go where that had stood: it looks, and goes there once more.
    """
    taken: list[None] = []
    seen = iter(above)
    world = small_world()
    work = at_work(world)

    def found(*_: object) -> Generator[Array, None, tuple[None, None]]:
        yield from ()
        return None, None

    def rise(side: Side) -> Actions:
        raise MotionFailure("no_reach")

    monkeypatch.setattr(drop, "close_in", found)

    def take_up(*_: object) -> Actions:
        taken.append(None)
        yield from ()

    for name in ("lines", "look_at", "release"):
        monkeypatch.setattr(drop, name, nothing)
    monkeypatch.setattr(drop, "take_up", take_up)
    monkeypatch.setattr(drop, "_above", lambda *_: next(seen))
    monkeypatch.setattr(work, "rise", rise)
    going = drop.drop_in(work, "left", "box", [])
    with pytest.raises(StopIteration) as end:
        next(going)
    assert end.value.value is True
    assert len(taken) == times


@pytest.mark.parametrize(
    ("low_m", "high_m", "missed"),
    [(0.0, 0.2, False), (0.15, 0.2, False), (0.0, 0.07, False), (-0.4, -0.33, True), (0.1, 0.3, True)],
)
def test_what_an_arm_hides_half_of_is_where_it_was_set_down(
    monkeypatch: pytest.MonkeyPatch, low_m: float, high_m: float, missed: bool
) -> None:
    """Of a bottle behind an arm the cap is seen, of one that fell over the side; one on the floor was missed."""
    table_m, bottle = 0.42, SimpleNamespace(name="bottle")
    seen = box((0.5, 0.0, table_m + (low_m + high_m) / 2), (0.07, 0.07, high_m - low_m))
    scene = SimpleNamespace(solids=lambda name: [seen])

    def place_at(*_: object) -> Generator[Array, None, Array]:
        yield from ()
        return np.array([table_m, table_m + 0.2])

    for name, stand_in in (("place_at", place_at), ("draw_in", nothing), ("settle", nothing), ("come_out", nothing)):
        monkeypatch.setattr(place, name, stand_in)
    work = cast("Work", SimpleNamespace(load=lambda side: bottle, see=nothing, scene=scene))
    with pytest.raises(MotionFailure, match="missed") if missed else nullcontext():
        list(place.set_on_floor(work, "left", []))


@pytest.mark.parametrize(
    ("down", "reasons", "taken", "calls", "fails"),
    [
        (-1.0, [], True, ["put"], None),
        (-1.0, ["no_stance"], True, ["put", "take", "put"], None),
        (-1.0, ["no_free_spot", "no_stance"], True, ["put", "take", "put"], "no_stance"),
        (-1.0, ["no_stance"], False, ["put", "take"], "no_stance"),
        (-0.3, ["no_stance"], True, ["put"], "no_stance"),
        (-1.0, ["slipped"], True, ["put"], "slipped"),
    ],
)
def test_what_was_taken_from_above_is_taken_from_a_side_where_a_container_is_too_low(
    monkeypatch: pytest.MonkeyPatch, down: float, reasons: list[str], taken: bool, calls: list[str], fails: str | None
) -> None:
    """Once, and only with a hand that points down."""
    left, made = list(reasons), list[str]()

    def put(work: Work, side: Side, container: str, tried: list[Array]) -> Generator[Array, None, bool]:
        made.append("put")
        yield from ()
        if left:
            raise MotionFailure(left.pop(0))
        return True

    def take(work: Work, side: Side, name: str, container: str) -> Generator[Array, None, bool]:
        made.append("take")
        yield from ()
        return taken

    monkeypatch.setattr(place, "_put_in", put)
    monkeypatch.setattr(place, "_taken_from_a_side", take)
    way = np.array([np.sqrt(1 - down**2), 0.0, down])
    hand = kin.transform(kin.hand_rotation(way, np.array([0.0, 1.0, 0.0])), np.zeros(3))
    said = SimpleNamespace(
        hand_with=lambda phrase, wanted: "left", same=lambda phrase, ajar: "microwave",
        load=lambda side: SimpleNamespace(name="bag"), hand=lambda side: hand,
    )  # fmt: skip
    with nullcontext() if fails is None else pytest.raises(MotionFailure, match=fails):
        list(place.place_in(cast("Work", said), {"object": "bag", "container": "microwave"}, []))
    assert made == calls
