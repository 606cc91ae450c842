"""Starts of instances: room enough for robot and hands, reachable, repeatable, different."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from mpvi_bt.ground import paths
from mpvi_bt.ground.errors import BackendError, UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.collision import Surroundings
from mpvi_bt.house.goals.formula import Literal
from mpvi_bt.house.goals.problem import BddlProblem, Fact, load_problem, parse_problem
from mpvi_bt.house.instances.sampling import OPEN, Start, sample, scene_names
from mpvi_bt.house.instances.tasks import load_task
from mpvi_bt.house.layout.boards import ABOVE_M, ASKEW_RAD, FRONT_M, GAPS_M
from mpvi_bt.house.layout.ground import APART_M, DOORWAY_M, OBJECT_CLEARANCE_M, PASSAGE_M, ROBOT_CLEARANCE_M, Ground
from mpvi_bt.house.layout.house import load_house
from mpvi_bt.house.layout.prior_map import obstacles, prior_map
from mpvi_bt.house.things.catalogue import load_catalogue
from tests.small_house import small_house

HOUSE, CATALOGUE = load_house(), load_catalogue()
TASK = load_task("picking_up_trash")
PROBLEM = load_problem(TASK.problem)
MAP = prior_map(HOUSE)
CELL_M = MAP.resolution_m * np.sqrt(2) / 2  # from the middle of a cell to its corner
BOXES = [solid.aabb()[:, :2] for solid in obstacles(HOUSE)]
DRAWN: dict[str, Start] = {}
SEEDS = [
    *([zlib.crc32(TASK.problem.encode()), instance, 0] for instance in range(TASK.instances)),
    *([seed] for seed in range(20)),
]


def start(seed: list[int]) -> Start:
    """The start of a seed, drawn once."""
    if str(seed) not in DRAWN:
        DRAWN[str(seed)] = draw(seed)
    return DRAWN[str(seed)]


def draw(seed: list[int]) -> Start:
    return sample(HOUSE, CATALOGUE, PROBLEM, TASK.bindings, np.random.default_rng(seed))


def radius(name: str, begin: Start) -> float:
    low, high = begin.objects[name].entry.description.extent()
    return float(np.hypot(*(high - low)[:2])) / 2


def free_floor(xy: Array) -> float:
    """Distance [m] to the nearest wall or fixture, by boxes around them."""
    return min(float(np.linalg.norm(np.maximum(np.maximum(low - xy, xy - high), 0))) for low, high in BOXES)


@pytest.mark.parametrize("seed", SEEDS, ids=str)
def test_a_start_keeps_its_distances(seed: list[int]) -> None:
    """Robot and objects have their free floor, stand apart, leave doorways free, and are in the rooms of :init."""
    begin = start(seed)
    places = {name: p.T_world[:2, 3] for name, p in begin.objects.items()}
    assert set(places) == set(PROBLEM.movables)
    for fact in PROBLEM.init:
        if fact.literal.predicate == "ontop" and fact.literal.args[0] in places:
            room = PROBLEM.rooms[fact.literal.args[1]]
            assert MAP.room_at(places[fact.literal.args[0]]) == room
    assert MAP.room_at(begin.base_pose) == PROBLEM.agent_room
    # what is marked on the map is a cell at most from what stands there
    assert free_floor(begin.base_pose[:2]) > ROBOT_CLEARANCE_M - CELL_M
    circles = {name: (xy, radius(name, begin)) for name, xy in places.items()}
    for name, (xy, r) in circles.items():
        assert free_floor(xy) > r + OBJECT_CLEARANCE_M - CELL_M, name
        assert begin.objects[name].T_world[2, 3] == pytest.approx(0.0, abs=0.01)
    circles["robot"] = (begin.base_pose[:2], 0.0)
    for name, (xy, r) in circles.items():
        assert min(np.linalg.norm(xy - d.at) for d in HOUSE.doorways) > DOORWAY_M, name
        for other, (uv, s) in circles.items():
            assert other == name or np.linalg.norm(xy - uv) > r + s + APART_M


@pytest.mark.parametrize("seed", SEEDS[:10], ids=str)
def test_everything_can_be_reached_from_the_robot(seed: list[int]) -> None:
    """A base of 0.31 m can drive from the start to within half a meter of every object."""
    begin = start(seed)
    wide = ndimage.distance_transform_edt(~MAP.occupied) * MAP.resolution_m > 0.31 + CELL_M
    regions, _ = ndimage.label(wide)
    here = regions[MAP.cell(begin.base_pose)]
    assert here > 0
    near = ndimage.distance_transform_edt(regions != here) * MAP.resolution_m
    for name, placement in begin.objects.items():
        assert near[MAP.cell(placement.T_world[:2, 3])] < 0.55, name


def flat(begin: Start) -> Array:
    return np.concatenate([begin.base_pose, *(p.T_world.ravel() for p in begin.objects.values())])


def test_a_draw_is_repeatable_and_others_differ() -> None:
    """The same randomness gives the same start, number for number; no two instances begin alike."""
    starts = [flat(start(seed)) for seed in SEEDS]
    for seed, first in list(zip(SEEDS, starts, strict=True))[::4]:
        np.testing.assert_array_equal(flat(draw(seed)), first)
    for i, one in enumerate(starts):
        for other in starts[:i]:
            assert np.abs(one - other).max() > 0.05


def test_scene_names_bind_each_fixture_once() -> None:
    """Floors bind to their rooms' floors, fixtures to fixtures of their synset and room, no two to the same."""
    bound = scene_names(HOUSE, PROBLEM)
    assert bound == start([0]).scene_names
    assert len(set(bound.values())) == len(bound)
    for name, scene in bound.items():
        assert PROBLEM.rooms[name] in (scene.removeprefix("floor_"), getattr(HOUSE.fixtures.get(scene), "room", None))


def problem(text: str) -> BddlProblem:
    return parse_problem(text, "mine")


def mine(init: str, objects: str = "can__of__soda.n.01_1 - can__of__soda.n.01", room: str = "kitchen") -> BddlProblem:
    """A problem of one can, a floor and the robot."""
    return problem(
        f"""(define (problem mine_0) (:domain omnigibson)
        (:objects {objects} floor.n.01_1 - floor.n.01 table.n.02_1 - table.n.02 agent.n.01_1 - agent.n.01)
        (:init {init} (inroom floor.n.01_1 {room}) (ontop agent.n.01_1 floor.n.01_1))
        (:goal (and (ontop ?can__of__soda.n.01_1 ?floor.n.01_1))))"""
    )


BINDINGS: Mapping[str, str] = {"can__of__soda.n.01": "can_of_soda"}


def test_a_table_can_carry_things() -> None:
    """What is to be on top of a fixture is drawn on its upper face, away from the edge and from the others."""
    house = small_house(table_1="{entry: table, at: [1.0, 1.0]}")
    on_table = mine(
        "(ontop can__of__soda.n.01_1 table.n.02_1) (ontop can__of__soda.n.01_2 table.n.02_1) "
        "(inroom table.n.02_1 hall)",
        "can__of__soda.n.01_1 can__of__soda.n.01_2 - can__of__soda.n.01",
        "hall",
    )
    for seed in range(10):
        begin = sample(house, CATALOGUE, on_table, BINDINGS, np.random.default_rng(seed))
        low, high = house.fixtures["table_1"].extent()
        one, other = (p.T_world[:3, 3] for p in begin.objects.values())
        for p in (one, other):
            assert p[2] == pytest.approx(high[2], abs=0.01)
            assert (p[:2] > low[:2] + 0.03).all()
            assert (p[:2] < high[:2] - 0.03).all()
        assert np.linalg.norm(one - other) > 0.066 + 0.05


def test_things_on_a_crowded_or_turned_surface_stand_on_it() -> None:
    """Nothing is drawn into what stands on a counter already, nor beside a table that stands askew."""
    house = small_house(
        table_1="{entry: table, at: [1.0, 1.0], yaw_deg: 30}", oven="{entry: microwave, at: [1.0, 1.0], z_m: 0.75}"
    )
    on_table = mine("(ontop can__of__soda.n.01_1 table.n.02_1) (inroom table.n.02_1 hall)", room="hall")
    oven = Surroundings(list(house.fixtures["oven"].solids()))
    table = Surroundings(list(house.fixtures["table_1"].solids()))
    for seed in range(20):
        begin = sample(house, CATALOGUE, on_table, BINDINGS, np.random.default_rng(seed))
        (p,) = (placement.T_world[:3, 3] for placement in begin.objects.values())
        ring = p + np.array([[0.033, 0, 0], [-0.033, 0, 0], [0, 0.033, 0], [0, -0.033, 0]])
        assert table.distance(ring).max() < 0.005
        assert oven.distance(p[None] + [0, 0, 0.05])[0] > 0.033


FURNISHED = """(define (problem mine_0) (:domain omnigibson)
    (:objects {objects} - can__of__soda.n.01 book.n.02_1 - book.n.02 wicker_basket.n.01_1 - wicker_basket.n.01
        cabinet.n.01_1 - cabinet.n.01 table.n.02_1 - table.n.02 floor.n.01_1 - floor.n.01 agent.n.01_1 - agent.n.01)
    (:init {init} (inroom cabinet.n.01_1 hall) (inroom table.n.02_1 hall) (inroom floor.n.01_1 hall)
        (ontop agent.n.01_1 floor.n.01_1))
    (:goal (and (ontop ?book.n.02_1 ?floor.n.01_1))))"""
HALL = small_house(cabinet="{entry: tall_cabinet, at: [-2.5, 1.0]}", table="{entry: table, at: [2.0, 1.0]}")
THINGS = {**BINDINGS, "book.n.02": "book", "wicker_basket.n.01": "wicker_basket"}


def furnished(init: str, cans: int = 1) -> BddlProblem:
    """A problem of cans, a book, a basket, a cabinet and a table; everything but the cans has its place."""
    names = [f"can__of__soda.n.01_{k + 1}" for k in range(cans)]
    facts = " ".join(init.format(name) for name in names)
    rest = "(ontop book.n.02_1 table.n.02_1) (ontop wicker_basket.n.01_1 floor.n.01_1)"
    return problem(FURNISHED.format(objects=" ".join(names), init=f"{facts} {rest}"))


def in_hall(of: BddlProblem, seed: int) -> Start:
    return sample(HALL, CATALOGUE, of, THINGS, np.random.default_rng(seed))


@pytest.mark.parametrize("seed", range(5))
def test_what_is_in_a_cabinet_is_near_its_front_with_room_for_a_hand(seed: int) -> None:
    """Things stand on boards inside, clear of walls, door and the board above, and of each other."""
    begin = in_hall(furnished("(inside {} cabinet.n.01_1)", 4), seed)
    cabinet = HALL.fixtures["cabinet"]
    solids = Surroundings(list(cabinet.solids()))
    (volume,) = (v.moved(cabinet.T_world_fixture) for v in cabinet.entry.description.root.volumes)
    low, high = volume.aabb()
    spots = [p.T_world[:3, 3] for name, p in begin.objects.items() if name.startswith("can")]
    for spot in spots:
        assert ((low < spot) & (spot < high)).all()
        assert high[0] - spot[0] < FRONT_M + 1e-6
        assert solids.distance(spot[None] + [0, 0, 0.06])[0] > 0.033 + GAPS_M[-1] - 1e-6
        assert solids.distance(spot[None] + [0, 0, 0.122 + ABOVE_M])[0] > 0
        assert solids.distance(spot[None] - [0, 0, 0.01])[0] == 0  # a board carries it
    assert all(np.linalg.norm(a - b) > 0.066 for i, a in enumerate(spots) for b in spots[:i])


def test_what_is_under_a_table_is_on_the_floor_below_it() -> None:
    """It lies between the legs, its middle covered by the top."""
    table = HALL.fixtures["table"]
    for seed in range(5):
        p = in_hall(furnished("(under {} table.n.02_1)"), seed).objects["can__of__soda.n.01_1"].T_world[:3, 3]
        low, high = table.extent()
        assert ((low[:2] < p[:2]) & (p[:2] < high[:2])).all()
        assert p[2] == pytest.approx(0.0, abs=0.01)
        assert Surroundings(list(table.solids())).distance(p[None] + [0, 0, 0.05])[0] > 0.033


def test_what_is_on_a_thing_lies_on_it_wherever_that_is() -> None:
    """A can stands on a book on a table, within its edges."""
    for seed in range(5):
        begin = in_hall(furnished("(ontop {} book.n.02_1)"), seed)
        book, can = (begin.objects[name] for name in ("book.n.02_1", "can__of__soda.n.01_1"))
        local = np.linalg.inv(book.T_world) @ can.T_world[:, 3]
        assert (np.abs(local[:2]) < np.array([0.075, 0.105]) - 0.033).all()
        assert local[2] == pytest.approx(0.03, abs=0.005)


def test_a_basket_that_is_full_is_heaped() -> None:
    """More balls than have room side by side in a basket lie on each other, all with their middle inside."""
    balls = {**THINGS, "can__of__soda.n.01": "tennis_ball"}
    full = furnished("(inside {} wicker_basket.n.01_1)", 14)
    begin = sample(HALL, CATALOGUE, full, balls, np.random.default_rng(0))
    basket = begin.objects["wicker_basket.n.01_1"]
    (volume,) = basket.entry.description.root.volumes
    middles = [p.T_world[:3, 3] + [0, 0, 0.0335] for n, p in begin.objects.items() if n.startswith("can")]
    low, high = volume.moved(basket.T_world).aabb()
    assert all(((low < m) & (m < high)).all() for m in middles)
    assert max(m[2] for m in middles) > min(m[2] for m in middles) + 0.05
    assert all(np.linalg.norm(a - b) > 0.0669 for i, a in enumerate(middles) for b in middles[:i])


def test_gaps_are_as_wide_as_the_number_of_things_allows() -> None:
    """Few cans on a table stand a hand's breadth apart; thirty still find room, nearer to each other."""

    def nearest(cans: int) -> float:
        begin = in_hall(furnished("(ontop {} table.n.02_1)", cans), 0)
        spots = [p.T_world[:2, 3] for name, p in begin.objects.items() if name.startswith("can")]
        return min(float(np.linalg.norm(a - b)) for i, a in enumerate(spots) for b in spots[:i]) - 0.066

    few, many = nearest(3), nearest(30)
    assert few > GAPS_M[0] - 1e-6
    assert GAPS_M[-1] - 1e-6 < many < GAPS_M[0]


def test_doors_are_closed_but_for_what_init_has_open() -> None:
    """What is open begins as far open as hands can mend, all else closed; cooked is taken as it is said."""
    closed = furnished("(ontop {} table.n.02_1) (not (open cabinet.n.01_1)) (cooked can__of__soda.n.01_1)")
    assert not in_hall(closed, 0).openings
    opened = furnished("(ontop {} table.n.02_1) (open cabinet.n.01_1) (toggled_on cabinet.n.01_1)")
    begin = in_hall(opened, 0)
    assert begin.openings == {"cabinet": {"door": OPEN}}
    assert begin.on == ("cabinet",)
    with pytest.raises(UserError, match="table has nothing that opens"):
        in_hall(furnished("(ontop {} table.n.02_1) (open table.n.02_1)"), 0)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (mine("(ontop can__of__soda.n.01_1 floor.n.01_1)", room="kitchn"), "unknown room 'kitchn'"),
        (mine("(nextto can__of__soda.n.01_1 floor.n.01_1)"), "nextto.*known: ontop, inside, under"),
        (mine("(inside can__of__soda.n.01_1 floor.n.01_1)"), "nothing can be inside a floor yet"),
        (mine("(ontop can__of__soda.n.01_1 table.n.02_1) (inroom table.n.02_1 garage)"), "no table.n.02 is left"),
        (mine("(ontop can__of__soda.n.01_1 table.n.02_1)"), ":init does not say where table.n.02_1 is"),
    ],
)
def test_what_cannot_be_sampled_is_said(wrong: BddlProblem, said: str) -> None:
    """Unknown rooms, missing fixtures and predicates that are not known yet are one clear error each."""
    with pytest.raises(UserError, match=said) as caught:
        sample(HOUSE, CATALOGUE, wrong, BINDINGS, np.random.default_rng(0))
    assert "\n" not in str(caught.value)


def test_a_robot_without_a_room_is_said() -> None:
    """Where :init does not say on which floor the robot is, that is said."""
    lost = replace(PROBLEM, init=tuple(f for f in PROBLEM.init if f.literal.args[0] != "agent.n.01_1"))
    with pytest.raises(UserError, match="where the robot begins"):
        sample(HOUSE, CATALOGUE, lost, TASK.bindings, np.random.default_rng(0))


def test_a_thing_without_a_binding_is_said() -> None:
    """A synset that is bound to no catalogue entry is an error that names it."""
    with pytest.raises(UserError, match=r"ashcan\.n\.01"):
        sample(HOUSE, CATALOGUE, PROBLEM, BINDINGS, np.random.default_rng(0))


@pytest.mark.rare
def test_a_full_floor_is_said() -> None:
    """Where there is no room for one thing more, the error names the room."""
    can = Fact(Literal("ontop", ("can__of__soda.n.01_1", "floor.n.01_1")))
    crowd = {f"can__of__soda.n.01_{k}": "can__of__soda.n.01" for k in range(1, 300)}
    crowded = replace(
        PROBLEM,
        objects={**PROBLEM.objects, **crowd},
        init=PROBLEM.init + tuple(replace(can, literal=Literal("ontop", (name, "floor.n.01_1"))) for name in crowd),
    )
    with pytest.raises(BackendError, match="no free place of radius"):
        sample(HOUSE, CATALOGUE, crowded, TASK.bindings, np.random.default_rng(0))


def test_a_thing_too_broad_for_a_table_is_said() -> None:
    """What has no room on a fixture's faces is an error that names the fixture."""
    house = small_house(table_1="{entry: table, at: [1.0, 1.0], shape: {size_m: [0.2, 0.2, 0.6]}}")
    broad = mine("(ontop can__of__soda.n.01_1 table.n.02_1) (inroom table.n.02_1 hall)", room="hall")
    with pytest.raises(BackendError, match="table_1"):
        sample(house, CATALOGUE, broad, {"can__of__soda.n.01": "trash_can"}, np.random.default_rng(0))


STARTS = [(name, instance) for name in paths.names("tasks") for instance in range(load_task(name).instances)]


def drawn(name: str, instance: int) -> tuple[BddlProblem, Start]:
    """The first start of an instance for which there is room, with its problem."""
    task = load_task(name)
    of = load_problem(task.problem)
    of = of.expanded({synset: len(HOUSE.fixtures_of(synset, room)) for synset, room in of.wildcards.items()})
    for attempt in range(20):
        rng = np.random.default_rng([zlib.crc32(task.problem.encode()), instance, attempt])
        try:
            return of, sample(HOUSE, CATALOGUE, of, task.bindings, rng)
        except BackendError:
            continue
    raise AssertionError(f"{name}, instance {instance}: no room in 20 draws")


@pytest.mark.parametrize(("name", "instance"), STARTS[::5], ids=str)
def test_every_task_has_room_for_its_things(name: str, instance: int) -> None:
    """Each thing is where :init has it: in its container, over its fixture, on its floor; grains fill vessels."""
    of, begin = drawn(name, instance)
    filling = {of.objects[fact.literal.args[1]] for fact in of.init if fact.literal.predicate == "filled"}
    assert {thing for thing in begin.objects if thing.rpartition("_")[0] not in filling} == set(of.movables)
    for fact in of.init:
        thing, place = (*fact.literal.args, "")[:2]
        if thing not in begin.objects:
            continue
        at = begin.objects[thing].T_world[:3, 3]
        if fact.literal.predicate not in ("ontop", "inside", "under"):
            continue
        scene = begin.scene_names.get(place, place)
        if scene.startswith("floor_"):
            assert MAP.room_at(at[:2]) == scene.removeprefix("floor_")
            continue
        T = begin.objects[place].T_world if scene == place else HOUSE.fixtures[scene].T_world_fixture
        carrier = begin.objects[place].entry if scene == place else HOUSE.fixtures[scene].entry
        low, high = carrier.description.extent(T)
        assert ((low[:2] < at[:2]) & (at[:2] < high[:2])).all()
        if fact.literal.predicate == "inside":
            boxes = [volume.moved(T).aabb() for volume in carrier.description.root.volumes]
            assert any(((low - 0.005 < at) & (at < high)).all() for low, high in boxes)


def test_a_robot_that_begins_on_a_lawn_stands_on_it() -> None:
    """What is flat enough to drive over is ground, not an obstacle."""
    _, begin = drawn("hiding_Easter_eggs", 0)
    low, high = HOUSE.fixtures[begin.scene_names["lawn.n.01_1"]].extent()
    assert ((low[:2] < begin.base_pose[:2]) & (begin.base_pose[:2] < high[:2])).all()


@pytest.mark.parametrize("instance", range(0, 10, 3))
def test_what_takes_two_hands_lies_square_and_near(instance: int) -> None:
    """A book on a bed is within reach of two arms from a side, and turned from it by no more than a quarter radian."""
    _, begin = drawn("tidying_bedroom", instance)
    T = begin.objects["book.n.02_1"].T_world
    low, high = HOUSE.fixtures[begin.scene_names["bed.n.01_1"]].extent()
    assert min(*(T[:2, 3] - low[:2]), *(high[:2] - T[:2, 3])) < 0.3
    turned = float(np.arctan2(T[1, 0], T[0, 0]))
    assert abs((turned + np.pi / 4) % (np.pi / 2) - np.pi / 4) < ASKEW_RAD + 0.15


def test_nobody_reaches_through_a_wall() -> None:
    """The back of a bench is looked at, and reached, from its room, though the floor beyond the wall is nearer."""
    low, high = HOUSE.fixtures["tabletop_1"].extent()
    back = np.array([((low[0] + high[0]) / 2, low[1] + 0.05)])
    ground = Ground(HOUSE)
    assert np.sin(ground.ahead(back))[0] < -0.9
    assert ground.away_m(back)[0] > high[1] - back[0, 1]


@pytest.mark.parametrize("instance", [1, 5])
def test_what_has_a_lid_looks_at_whoever_stands_there(instance: int) -> None:
    """The bar of a toolbox on a bench that stands at a wall is on the side of the room."""
    _, begin = drawn("outfit_a_basic_toolbox", instance)
    assert begin.objects["toolbox.n.01_1"].T_world[1, 0] > 0.9


@pytest.mark.parametrize("instance", range(0, 10, 3))
def test_a_monitor_stands_behind_what_one_works_with(instance: int) -> None:
    """Its screen looks at whoever sits there, and what takes two hands is nearer to the front."""
    _, begin = drawn("getting_organized_for_work", instance)
    ahead = HOUSE.fixtures[begin.scene_names["desk.n.01_1"]].T_world_fixture[:2, 0]
    monitor = begin.objects["monitor.n.04_1"].T_world
    assert monitor[:2, 0] @ ahead > 0.95
    assert (begin.objects["notebook.n.01_1"].T_world - monitor)[:2, 3] @ ahead > 0.0


@pytest.mark.parametrize("instance", range(0, 10, 3))
def test_things_in_a_corridor_leave_a_way(instance: int) -> None:
    """A robot gets along the corridor from door to door past all the shoes, not leaving it."""
    _, begin = drawn("putting_shoes_on_rack", instance)
    rows, columns = np.indices(MAP.occupied.shape)
    occupied = MAP.occupied.copy()
    for name, p in begin.objects.items():
        cell = MAP.cell(p.T_world[:2, 3])
        occupied |= np.hypot(rows - cell[0], columns - cell[1]) * MAP.resolution_m < radius(name, begin)
    corridor = MAP.rooms == MAP.room_names.index("corridor")
    wide = ndimage.distance_transform_edt(~occupied) * MAP.resolution_m > PASSAGE_M
    parts, _ = ndimage.label(wide & corridor)
    nearest = ndimage.distance_transform_edt(parts == 0, return_distances=False, return_indices=True)
    ends = [d.at for d in HOUSE.doorways if "corridor" in d.rooms]
    assert len({int(parts[tuple(nearest[(slice(None), *MAP.cell(np.array(end)))])]) for end in ends}) == 1
