"""Laws of goal poses, pursuit and the navigator, on hand-made maps."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mpvi_bt.executive.plan.knowledge import Entry, KnowledgeBase
from mpvi_bt.finding.navigation.goals import (
    HandoffDistances,
    at_target,
    distance_to,
    facing_yaw,
    object_goals,
    room_goals,
)
from mpvi_bt.finding.navigation.grid import shortest_path
from mpvi_bt.finding.navigation.navigator import KnownPlaceNavigator
from mpvi_bt.finding.navigation.pursuit import CARRYING, Limits, PathFollower
from mpvi_bt.finding.navigation.traversability import traversability
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.geometry.kinematics import wrap
from mpvi_bt.ground.protocols import Progress, Report
from mpvi_bt.ground.robot.protocol import CONTROL_HZ
from mpvi_bt.testing import check_navigator
from tests.layouts import BASE, LAYOUT
from tests.navigation_maps import KinematicRobot, put_box, thing, two_rooms

HANDOFF = HandoffDistances()


def knowing(*entries: Entry) -> KnowledgeBase:
    """A knowledge base of these."""
    base = KnowledgeBase()
    for entry in entries:
        base.put(entry)
    return base


def drive(
    robot: KinematicRobot, navigator: KnownPlaceNavigator, target: str, room: str | None = None, most_s: float = 90.0
) -> tuple[Report, list[np.ndarray]]:
    """Run a drive to its end; the last report and the trace of poses."""
    navigator.start(target, room)
    trace = [robot.pose.copy()]
    for _ in range(round(most_s * CONTROL_HZ)):
        report = navigator.step()
        if report.progress is not Progress.RUNNING:
            return report, trace
        robot.advance()
        trace.append(robot.pose.copy())
    raise AssertionError(f"still {report} after {most_s} s at {robot.pose}")


# ---------------------------------------------------------------------------------------------------- goals


@settings(max_examples=40, deadline=None)
@given(st.floats(0.6, 3.3), st.floats(0.6, 3.4), st.floats(0.05, 0.6), st.floats(0.05, 0.6))
def test_goals_are_free_facing_reachable_in_the_room_and_within_reach(
    x: float, y: float, width: float, depth: float
) -> None:
    """Every goal before a thing on the kitchen floor has all the properties that a handoff needs."""
    assume(x + width / 2 < 3.2)  # else it may stand in the doorway at x = 4
    grid_map, entry = two_rooms(), thing("can", (x, y, 0.1), (width, depth, 0.2))
    start = np.array([7.0, 3.0])
    grid = traversability(grid_map, 0.33, [(entry.lowest, entry.highest)])
    goals = object_goals(entry, start, grid, HANDOFF)
    assert goals
    for goal in goals:
        xy = goal.pose[:2]
        assert 0.33 <= distance_to(entry, xy) <= HANDOFF.distance_m
        assert abs(wrap(goal.pose[2] - float(facing_yaw(entry, xy)))) < 1e-9
        assert at_target(entry, goal.pose, grid, HANDOFF)
        assert grid_map.room_at(xy) == "kitchen"
        assert shortest_path(grid.cost, grid_map.cell(start), grid_map.cell(xy)) is not None


def test_goals_keep_out_of_the_room_behind_the_wall() -> None:
    """A shelf on the wall between two rooms is served from its own room only, however near the other side is."""
    grid_map = two_rooms()
    put_box(grid_map, (4.05, 0.5), (4.35, 1.2))
    shelf = thing("shelf", (4.2, 0.85, 0.9), (0.3, 0.7, 1.8), kind="fixture", room="living_room")
    grid = traversability(grid_map, 0.33)
    goals = object_goals(shelf, np.array([1.0, 1.0]), grid, HANDOFF, most=1000)
    assert goals
    assert all(goal.pose[0] > 4.05 for goal in goals)


def test_goals_before_a_counter_are_square_to_its_middle() -> None:
    """The best place before a long counter is across from its middle, facing it squarely."""
    grid_map = two_rooms()
    put_box(grid_map, (0.8, 0.05), (3.2, 0.65))
    counter = thing("counter", (2.0, 0.35, 0.45), (2.4, 0.6, 0.9), kind="fixture", room="kitchen")
    goal = object_goals(counter, np.array([2.0, 3.0]), traversability(grid_map, 0.33), HANDOFF)[0]
    assert abs(goal.pose[0] - 2.0) < 0.4
    assert abs(goal.pose[2] + math.pi / 2) < 0.05


def test_goals_before_what_opens_are_at_its_front() -> None:
    """A car is served from its trunk, although its side is nearer."""
    grid_map = two_rooms()
    put_box(grid_map, (1.4, 1.5), (2.9, 2.5))
    car = thing("car", (2.15, 2.0, 0.7), (1.5, 1.0, 1.4), kind="fixture", room="kitchen")
    start = np.array([2.15, 0.8])
    grid = traversability(grid_map, 0.33)
    assert object_goals(car, start, grid, HANDOFF)[0].pose[1] < 1.5
    car.front = np.array([-1.0, 0.0])
    assert object_goals(car, start, grid, HANDOFF)[0].pose[0] < 1.4


def test_a_thing_deep_on_a_wide_table_is_approached_as_near_as_can_be() -> None:
    """Where nothing is free within the handoff distance, up to the slack more is taken."""
    grid_map = two_rooms()
    put_box(grid_map, (1.2, 1.2), (2.8, 2.8))
    cup = thing("cup", (2.0, 2.0, 0.8), (0.08, 0.08, 0.1), room="kitchen")
    goals = object_goals(cup, np.array([0.6, 0.6]), traversability(grid_map, 0.33), HANDOFF)
    assert goals
    assert HANDOFF.distance_m < distance_to(cup, goals[0].pose[:2]) <= HANDOFF.distance_m + HANDOFF.slack_m


def test_a_screen_between_hides_the_target() -> None:
    """A goal pose is not across another obstacle from the target."""
    grid_map = two_rooms()
    put_box(grid_map, (1.0, 1.9), (3.0, 2.0))
    can = thing("can", (2.0, 1.7, 0.06), (0.07, 0.07, 0.12), room="kitchen")
    goals = object_goals(can, np.array([2.0, 3.0]), traversability(grid_map, 0.33), HANDOFF, most=1000)
    assert goals
    assert all(goal.pose[1] < 1.9 or not 1.2 < goal.pose[0] < 2.8 for goal in goals)


def test_a_room_goal_is_well_inside() -> None:
    """Driving to a room ends inside it, away from its doorway."""
    grid_map = two_rooms()
    goals = room_goals("living_room", np.array([1.0, 2.0]), traversability(grid_map, 0.33))
    assert goals
    for goal in goals:
        assert grid_map.room_at(goal.pose[:2]) == "living_room"
        assert goal.pose[0] >= 4.06 + 0.5
    assert room_goals("attic", np.array([1.0, 2.0]), traversability(grid_map, 0.33)) == []


# -------------------------------------------------------------------------------------------------- pursuit


@settings(max_examples=25, deadline=None)
@given(
    st.tuples(st.floats(0.5, 3.5), st.floats(0.5, 3.5), st.floats(-3.1, 3.1)),
    st.tuples(st.floats(4.6, 7.5), st.floats(0.5, 3.5), st.floats(-3.1, 3.1)),
    st.sampled_from([Limits(), CARRYING]),
)
def test_pursuit_reaches_the_pose_within_limits_and_off_inflated_cells(
    start: tuple[float, float, float], goal: tuple[float, float, float], limits: Limits
) -> None:
    """Through the doorway to any pose: speed and acceleration stay in limits and the base where it may be."""
    grid = traversability(two_rooms(), 0.33)
    found = shortest_path(grid.cost, grid.map.cell(start[:2]), grid.map.cell(goal[:2]))
    assert found is not None
    follower = PathFollower(grid.points(found[0]), np.array(goal), grid, limits)
    robot = KinematicRobot(*start)
    dt = 1 / CONTROL_HZ
    world_before = np.zeros(3)
    for _ in range(60 * CONTROL_HZ):
        if follower.reached(robot.pose, robot.velocity):
            break
        command = follower.command(robot.pose)
        before = robot.pose.copy()
        robot.action[BASE] = command
        robot.advance()
        world = np.append((robot.pose - before)[:2] / dt, command[2])
        assert np.linalg.norm(world[:2]) <= limits.speed_m_s + 1e-6
        assert abs(world[2]) <= limits.turn_rad_s + 1e-6
        assert np.linalg.norm(world[:2] - world_before[:2]) <= limits.acceleration_m_s2 * dt + 1e-6
        assert abs(world[2] - world_before[2]) <= limits.turn_acceleration_rad_s2 * dt + 1e-6
        world_before = world
        assert not grid.blocked[tuple(np.floor(grid.cells(robot.pose[:2])).astype(int))]
    assert np.linalg.norm(robot.pose[:2] - np.array(goal[:2])) <= 0.03
    assert abs(wrap(robot.pose[2] - goal[2])) <= 0.05


def test_a_base_with_a_lagging_drive_still_settles() -> None:
    """A first-order lag of 0.1 s in the base, as a physical drive has, causes no endless hunting."""
    grid = traversability(two_rooms(), 0.33)
    goal = np.array([3.0, 3.0, 1.0])
    follower = PathFollower(np.array([[1.0, 1.0], [2.0, 2.0], [3.0, 3.0]]), goal, grid)
    robot, felt = KinematicRobot(1.0, 1.0), np.zeros(3)
    for _ in range(15 * CONTROL_HZ):
        if follower.reached(robot.pose, robot.velocity):
            break
        felt += (follower.command(robot.pose) - felt) / 3
        robot.action[BASE] = felt
        robot.advance()
    assert follower.reached(robot.pose, robot.velocity)


# ------------------------------------------------------------------------------------------------ navigator


def test_it_drives_through_the_doorway_to_an_object_and_stands_facing_it() -> None:
    """The whole way: known object in the other room, ending within the handoff distance, facing it."""
    grid_map, robot = two_rooms(), KinematicRobot(1.0, 1.0, 2.0)
    can = thing("can_of_soda", (6.5, 3.0, 0.06), (0.07, 0.07, 0.12), room="living_room")
    report, trace = drive(robot, KnownPlaceNavigator(robot, grid_map, knowing(can)), "a can of soda", "living room")
    assert report == Report(Progress.SUCCEEDED, "", "arrived")
    assert at_target(can, robot.pose, traversability(grid_map, 0.33), HANDOFF)
    clear = traversability(grid_map, 0.33, [(can.lowest, can.highest)])
    assert all(np.isfinite(clear.cost[grid_map.cell(pose[:2])]) for pose in trace)
    assert (robot.action[BASE] == 0).all()


def test_it_keeps_the_contract_of_a_navigator() -> None:
    """The same checks as every navigator, ours or a user's."""
    robot = KinematicRobot(1.0, 1.0)
    navigator = KnownPlaceNavigator(robot, two_rooms(), knowing())
    check_navigator(navigator, robot, robot.advance, "living room")


def test_at_the_target_already_it_is_done_without_a_move() -> None:
    """Within the handoff distance and facing the target, navigation is complete (Paper, Navigation appendix)."""
    robot = KinematicRobot(2.0, 2.0, 0.0)
    can = thing("can", (2.8, 2.0, 0.06), (0.07, 0.07, 0.12))
    report, trace = drive(robot, KnownPlaceNavigator(robot, two_rooms(), knowing(can)), "can")
    assert report.progress is Progress.SUCCEEDED
    assert len(trace) == 1


@pytest.mark.parametrize("start", [(2.0, 1.9, 0.0), (0.8, 2.2, 0.0)])
def test_whoever_is_sent_to_another_can_stands_nearer_to_it_than_to_the_one_in_the_bin(
    start: tuple[float, float, float],
) -> None:
    """A skill that only sees takes the nearest. With nothing put away it need not move."""
    can = thing("can_1", (2.8, 2.2, 0.06), (0.07, 0.07, 0.12))
    binned = thing("can_2", (2.8, 1.9, 0.06), (0.07, 0.07, 0.12))
    can.phrases = binned.phrases = ("can",)
    binned.inside, binned.laid = "bin", True
    bin_ = thing("bin", (2.8, 1.9, 0.15), (0.3, 0.3, 0.3))
    robot = KinematicRobot(*start)
    report, _ = drive(robot, KnownPlaceNavigator(robot, two_rooms(), knowing(bin_, binned, can)), "can")
    assert report.progress is Progress.SUCCEEDED
    near, far = (float(np.linalg.norm(e.center[:2] - robot.pose[:2])) for e in (can, binned))
    assert near < far
    binned.laid, binned.inside = False, None
    _, trace = drive(robot, KnownPlaceNavigator(robot, two_rooms(), knowing(bin_, binned, can)), "can")
    assert len(trace) == 1


def test_near_the_target_but_facing_away_it_turns() -> None:
    """Being near is not enough: the target must be before the robot."""
    robot = KinematicRobot(2.0, 2.0, math.pi)
    can = thing("can", (2.8, 2.0, 0.06), (0.07, 0.07, 0.12))
    report, _ = drive(robot, KnownPlaceNavigator(robot, two_rooms(), knowing(can)), "can")
    assert report.progress is Progress.SUCCEEDED
    assert abs(wrap(robot.pose[2] - float(facing_yaw(can, robot.pose[:2])))) < HANDOFF.facing_rad


def test_a_room_is_a_target_too() -> None:
    """A room of the map can be driven to, known to the knowledge base or not, however its name is spelled."""
    robot = KinematicRobot(1.0, 1.0)
    report, _ = drive(robot, KnownPlaceNavigator(robot, two_rooms(), knowing()), "the living room")
    assert report.progress is Progress.SUCCEEDED
    assert two_rooms().room_at(robot.pose[:2]) == "living_room"


def test_of_two_cans_the_nearer_by_road_comes_first() -> None:
    """A can behind the wall is farther than its distance says."""
    robot = KinematicRobot(3.5, 0.6, math.pi)
    here = thing("can_1", (1.0, 0.7, 0.06), (0.07, 0.07, 0.12), room="kitchen")
    behind_wall = thing("can_2", (4.6, 0.6, 0.06), (0.07, 0.07, 0.12), room="living_room")
    here.phrases = behind_wall.phrases = ("can",)
    drive(robot, KnownPlaceNavigator(robot, two_rooms(), knowing(behind_wall, here)), "can")
    assert distance_to(here, robot.pose[:2]) <= HANDOFF.distance_m


def test_what_is_carried_is_taken_to_where_others_alike_lie() -> None:
    """Of two trees alike the one beside which an egg lies comes first, though it is farther; the nearer without one."""
    near = thing("tree_1", (2.0, 0.8, 0.5), (0.2, 0.2, 1.0), kind="fixture")
    far = thing("tree_2", (2.0, 3.2, 0.5), (0.2, 0.2, 1.0), kind="fixture")
    near.phrases = far.phrases = ("tree",)
    carried = thing("egg_1", (0.8, 1.2, 0.8), (0.05, 0.05, 0.05), held=True)
    laid = thing("egg_2", (2.0, 3.05, 0.03), (0.05, 0.05, 0.05))
    carried.phrases = laid.phrases = ("egg",)
    for known, expected in ((knowing(near, far, carried), near), (knowing(near, far, carried, laid), far)):
        robot = KinematicRobot(0.8, 1.2)
        assert drive(robot, KnownPlaceNavigator(robot, two_rooms(), known), "tree")[0].progress is Progress.SUCCEEDED
        assert distance_to(expected, robot.pose[:2]) <= HANDOFF.distance_m


def test_the_fixture_that_it_was_at_is_meant_again() -> None:
    """Of two cabinets the one gone to first is gone to again from where the other is nearer, also after a restart."""
    first = thing("cabinet_1", (2.0, 0.8, 0.5), (0.2, 0.2, 1.0), kind="fixture")
    other = thing("cabinet_2", (2.0, 3.2, 0.5), (0.2, 0.2, 1.0), kind="fixture")
    first.phrases = other.phrases = ("cabinet",)
    robot = KinematicRobot(0.8, 1.0)
    navigator = KnownPlaceNavigator(robot, two_rooms(), knowing(first, other))
    drive(robot, navigator, "cabinet")
    assert distance_to(first, robot.pose[:2]) <= HANDOFF.distance_m
    been = navigator.save()
    none = been | {"been": {}}
    for remembers, said, expected in (
        (been, "the cabinet", first),
        (been, "another cabinet", other),
        (none, "the cabinet", other),
    ):
        robot = KinematicRobot(0.8, 1.0 if said == "another cabinet" else 3.0)
        navigator = KnownPlaceNavigator(robot, two_rooms(), knowing(first, other))
        navigator.restore(remembers)
        drive(robot, navigator, said)
        assert distance_to(expected, robot.pose[:2]) <= HANDOFF.distance_m


def test_another_is_one_that_was_not_left_lying() -> None:
    """What it came away from as it came is gone to again only when nothing else is called so, also after a restart."""
    near, far = (thing(f"can_{y}", (2.0, y, 0.06), (0.07, 0.07, 0.12)) for y in (0.8, 3.2))
    near.phrases = far.phrases = ("can",)

    def gone_to(said: str, left: dict[str, object], *cans: Entry) -> KinematicRobot:
        robot = KinematicRobot(0.8, 1.0)
        navigator = KnownPlaceNavigator(robot, two_rooms(), knowing(*cans))
        navigator.restore(left)
        assert drive(robot, navigator, said)[0].progress is Progress.SUCCEEDED
        return robot

    robot = KinematicRobot(0.8, 1.0)
    navigator = KnownPlaceNavigator(robot, two_rooms(), knowing(near, far))
    drive(robot, navigator, "can")
    assert distance_to(near, robot.pose[:2]) <= HANDOFF.distance_m
    came = navigator.save()
    for said, cans, expected in (
        ("another can", (near, far), far),
        ("the last can", (near, far), far),
        ("can", (near, far), near),
        ("another can", (near,), near),
    ):
        assert distance_to(expected, gone_to(said, came, *cans).pose[:2]) <= HANDOFF.distance_m
    took = came | {"held": 1}  # as if it had come with a full hand and let go of that: it did something there
    assert distance_to(near, gone_to("another can", took, near, far).pose[:2]) <= HANDOFF.distance_m


def test_the_basket_that_lacks_something_is_driven_to() -> None:
    """Of two baskets the one without a candle is meant though the other is nearer."""
    near, far = (thing(f"basket_{y}", (2.0, y, 0.1), (0.2, 0.2, 0.2)) for y in (0.8, 3.2))
    near.phrases = far.phrases = ("basket",)
    candle = thing("candle", (2.0, 0.8, 0.1), (0.05, 0.05, 0.1))
    candle.inside = near.name
    robot = KinematicRobot(0.8, 1.0)
    drive(robot, KnownPlaceNavigator(robot, two_rooms(), knowing(near, far, candle)), "basket without a candle")
    assert distance_to(far, robot.pose[:2]) <= HANDOFF.distance_m


def test_it_drives_around_loose_things_on_the_floor() -> None:
    """An object that the map lacks but the knowledge base holds is kept clear of."""
    robot, grid_map = KinematicRobot(0.8, 2.0), two_rooms()
    box = thing("box", (2.2, 2.0, 0.2), (0.5, 0.5, 0.4))
    can = thing("can", (3.5, 2.0, 0.06), (0.07, 0.07, 0.12))
    _, trace = drive(robot, KnownPlaceNavigator(robot, grid_map, knowing(box, can)), "can")
    assert min(distance_to(box, pose[:2]) for pose in trace) >= 0.33 - 0.03


def test_an_unknown_target_fails() -> None:
    """Neither entry nor room: nobody knows."""
    robot = KinematicRobot(1.0, 1.0)
    report, trace = drive(robot, KnownPlaceNavigator(robot, two_rooms(), knowing()), "unicorn")
    assert (report.progress, report.reason) == (Progress.FAILED, "unknown_target")
    assert len(trace) == 1
    report, _ = drive(robot, KnownPlaceNavigator(robot, two_rooms(), knowing()), "livng room")
    assert report.feedback.endswith("something near it is called 'living room'")


def test_an_unknown_target_is_looked_up_again_from_inside_its_room() -> None:
    """With a room named, the base goes there; what has been put on record meanwhile is driven to, else it fails."""
    for appears in (True, False):
        robot, base = KinematicRobot(1.0, 1.0), knowing()
        can = thing("can", (6.5, 3.0, 0.06), (0.07, 0.07, 0.12), room="living_room")

        def look_around(
            robot: KinematicRobot = robot, base: KnowledgeBase = base, can: Entry = can, appears: bool = appears
        ) -> KnowledgeBase:
            if appears and robot.pose[0] > 4.5:
                base.put(can)
            return base

        report, _ = drive(robot, KnownPlaceNavigator(robot, two_rooms(), look_around), "can", "living room")
        assert robot.pose[0] > 4.5
        assert report.progress is (Progress.SUCCEEDED if appears else Progress.FAILED)
        assert report.reason == ("" if appears else "unknown_target")


def test_no_path_when_walled_in() -> None:
    """A closed doorway leaves no way."""
    robot = KinematicRobot(1.0, 1.0)
    report, _ = drive(robot, KnownPlaceNavigator(robot, two_rooms(door_m=0.0), knowing()), "living_room")
    assert (report.progress, report.reason) == (Progress.FAILED, "no_path")


def test_a_target_that_cannot_be_stood_at_has_its_reason() -> None:
    """A room full of things, a thing walled in by furniture, one whose place is no number, a robot that is lost."""
    floor, robot = two_rooms(), KinematicRobot(1.0, 1.0)
    put_box(floor, (4.1, 0.05), (7.9, 3.9))
    report, _ = drive(robot, KnownPlaceNavigator(robot, floor, knowing()), "living_room")
    assert report == Report(
        Progress.FAILED, "goal_in_obstacle", "there is nowhere free to stand: no way to living_room"
    )
    vase = thing("vase", (6.0, 2.0, 0.9), (0.1, 0.1, 0.2), room="living_room")
    assert drive(robot, KnownPlaceNavigator(robot, floor, knowing(vase)), "vase")[0].reason == "goal_in_obstacle"
    ghost = thing("ghost", (math.nan, 2.0, 0.9), (0.1, 0.1, 0.2))
    assert drive(robot, KnownPlaceNavigator(robot, floor, knowing(ghost)), "ghost")[0].reason == "goal_in_obstacle"
    robot.pose[0] = math.nan
    for target in ("living_room", "vase"):
        report, _ = drive(robot, KnownPlaceNavigator(robot, two_rooms(), knowing(vase)), target)
        assert report.reason == "no_pose"


def test_an_unmapped_obstacle_is_driven_around_after_backing_off() -> None:
    """The first halt is answered by a way around it."""
    robot = KinematicRobot(0.8, 2.0)
    robot.walls = unmapped(1.9, 1.9, 2.1, 2.1)
    report, _ = drive(robot, KnownPlaceNavigator(robot, two_rooms(), knowing()), "living_room")
    assert report.progress is Progress.SUCCEEDED


def test_a_way_that_stays_blocked_fails() -> None:
    """The second halt ends the drive, with the base at rest."""
    robot = KinematicRobot(0.8, 2.0)
    robot.walls = unmapped(2.0, 0.0, 2.2, 4.0)
    report, _ = drive(robot, KnownPlaceNavigator(robot, two_rooms(), knowing()), "living_room")
    assert (report.progress, report.reason) == (Progress.FAILED, "blocked")
    assert (robot.action[BASE] == 0).all()


def unmapped(x0: float, y0: float, x1: float, y1: float) -> OccupancyMap:
    """A map that only the robot's bumper knows."""
    walls = two_rooms()
    walls.occupied[:] = False
    put_box(walls, (x0, y0), (x1, y1))
    return walls


class CountingStow:
    """Takes five steps, each of which writes a mark into the arm's part of the action."""

    def __init__(self, robot: KinematicRobot) -> None:
        self.robot, self.steps = robot, 0

    def start(self) -> None:
        """Begin anew."""
        self.steps = 0

    def step(self) -> bool:
        """Write the mark."""
        action = self.robot.action.copy()
        action[LAYOUT.arm["left"]] = 0.25
        self.robot.act(action)
        self.steps += 1
        return self.steps >= 5


def test_the_arms_are_tucked_before_the_base_moves_and_stay_so() -> None:
    """While stowing the navigator lets the base stand; while driving it leaves the arms' part of the command alone."""
    robot = KinematicRobot(1.0, 1.0)
    stow = CountingStow(robot)
    navigator = KnownPlaceNavigator(robot, two_rooms(), knowing(), stow)
    navigator.start("living_room", None)
    for _ in range(60):
        navigator.step()
        assert stow.steps == 5 or (robot.action[BASE] == 0).all()
        assert (robot.action[LAYOUT.arm["left"]] == 0.25).all()
        robot.advance()
    assert np.abs(robot.action[BASE]).max() > 0


class BackingStow(CountingStow):
    """Draws back while it takes its steps, as arms that reach over a table must."""

    def step(self) -> bool:
        """Write the mark, and a base that backs off."""
        done = super().step()
        action = self.robot.action.copy()
        action[BASE] = -0.2, 0.0, 0.0
        self.robot.act(action)
        return done


def test_a_stow_may_draw_the_base_back() -> None:
    """The navigator does not hold it: arms that were never folded would be driven through the house stretched out."""
    robot = KinematicRobot(1.0, 1.0)
    stow = BackingStow(robot)
    navigator = KnownPlaceNavigator(robot, two_rooms(), knowing(), stow)
    navigator.start("living_room", None)
    for _ in range(4):
        navigator.step()
        assert robot.action[BASE].tolist() == [-0.2, 0.0, 0.0]
        robot.advance()


def test_stop_leaves_the_base_at_rest_at_any_time() -> None:
    """Before a start, in the middle, and twice."""
    robot = KinematicRobot(1.0, 1.0)
    navigator = KnownPlaceNavigator(robot, two_rooms(), knowing())
    navigator.stop()
    navigator.start("living_room", None)
    for _ in range(30):
        navigator.step()
        robot.advance()
    assert np.abs(robot.action[BASE]).max() > 0
    navigator.stop()
    navigator.stop()
    assert (robot.action[BASE] == 0).all()


@pytest.mark.parametrize("width", [0.0, 0.05])
def test_a_full_hand_slows_the_start(width: float) -> None:
    """With something in a closed hand the base speeds up at no more than the gentle rate."""
    robot = KinematicRobot(1.0, 2.0)
    robot.gripper["left"] = (width, -1.0)
    navigator = KnownPlaceNavigator(robot, two_rooms(), knowing())
    navigator.start("living_room", None)
    navigator.step()
    robot.advance()
    navigator.step()
    speed = float(np.linalg.norm(robot.action[BASE][:2]))
    assert speed == pytest.approx((CARRYING if width else Limits()).acceleration_m_s2 * 2 / CONTROL_HZ, rel=0.05)


def test_a_navigator_that_leaves_stops_elsewhere_before_the_same_thing() -> None:
    """Where it is there already it stays, unless it is told to leave: then it stops 0.4 m away or more, once."""
    robot = KinematicRobot(2.0, 2.0)
    can = thing("can", (3.0, 2.0, 0.1), (0.1, 0.1, 0.2))
    navigator = KnownPlaceNavigator(robot, two_rooms(), knowing(can))
    assert drive(robot, navigator, "can")[0].progress is Progress.SUCCEEDED
    first = robot.pose.copy()
    assert drive(robot, navigator, "can")[0].progress is Progress.SUCCEEDED
    np.testing.assert_array_equal(robot.pose, first)
    navigator.leave()
    assert drive(robot, navigator, "can")[0].progress is Progress.SUCCEEDED
    second = robot.pose.copy()
    assert math.dist(second[:2], first[:2]) >= 0.4
    assert distance_to(can, second[:2]) <= HANDOFF.distance_m
    assert drive(robot, navigator, "can")[0].progress is Progress.SUCCEEDED
    np.testing.assert_array_equal(robot.pose, second)
