"""Laws of the path picture and of the video, over the shipped doubles."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import imageio_ffmpeg
import numpy as np
import pytest

from mpvi_bt.executive.drawing.text import Line, tree_lines
from mpvi_bt.executive.plan.knowledge import KnowledgeBase
from mpvi_bt.executive.plan.planners import RecordedPlanner
from mpvi_bt.executive.plan.skills import load_skills
from mpvi_bt.executive.ticking.goal_report import GoalCondition, GoalReport
from mpvi_bt.executive.ticking.loop import Outcome, Subscriber, Watcher, World, run_episode
from mpvi_bt.executive.tree.build import Tree
from mpvi_bt.executive.tree.compile import compile_plan
from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.executive.tree.yaml_io import parse_tree
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.ground.words.spoken import spoken, spoken_each, spoken_texts
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.house.sim.cutaway import is_near
from mpvi_bt.house.sim.views import look_at
from mpvi_bt.runs.recording import search_colors as colors
from mpvi_bt.runs.recording.cards import closing, opening
from mpvi_bt.runs.recording.frame_icons import ICONS
from mpvi_bt.runs.recording.frame_text import BAR, INKS, LEGEND, SIZE, Caption, plain, write
from mpvi_bt.runs.recording.labels import Labels, Picture, Rectangle
from mpvi_bt.runs.recording.named_house import name_things
from mpvi_bt.runs.recording.path_picture import PathPicture, path_picture
from mpvi_bt.runs.recording.video import Follower, Video, compose, has_index
from mpvi_bt.testing import KinematicWorld, scripted_context
from tests.navigation_maps import thing, two_rooms
from tests.search_views import MadeUpSearch, find
from tests.small_house import small_house

SKILLS = load_skills()
SPEC = compile_plan(RecordedPlanner().plan("picking_up_trash"), SKILLS)


WAITING = parse_tree("tree: waiting\nroot: {wait: 5}", "waiting.yaml")


class VisibleWorld(KinematicWorld):
    """A world that looks green from outside."""

    def __init__(self) -> None:
        super().__init__()
        self.looks = 0

    def look_from(self, T_world_camera: Array, size: tuple[int, int]) -> CameraImage:
        """Green."""
        self.looks += 1
        rgb = np.full((size[1], size[0], 3), (20, 200, 20), np.uint8)
        return CameraImage("outside", rgb, np.zeros(rgb.shape[:2], np.float32), None, {}, np.eye(3), T_world_camera)


class Interrupting(Watcher):
    """Presses Ctrl-C after a second."""

    def step(self, tree: Tree, world: World) -> None:
        """Raise when it is time."""
        if world.time_s >= 1.0:
            raise KeyboardInterrupt


def watch(world: KinematicWorld, *subscribers: Subscriber, spec: TreeSpec = SPEC, can_m: float = 1.0) -> None:
    """Run two seconds under the eyes of these; the trash can is so far away."""
    context = scripted_context(world, SKILLS, {"trash can": (can_m, 0.0), "can of soda": (0.0, 0.5)}, {})
    run_episode(Tree(spec), world, context, subscribers, max_time_s=2.0)


def frames(file: Path) -> list[np.ndarray]:
    """Every frame of a video, as a player would read it."""
    reader = imageio_ffmpeg.read_frames(str(file))
    width, height = next(reader)["size"]
    return [np.frombuffer(data, np.uint8).reshape(height, width, 3) for data in reader]


def unlabeled(grid_map: OccupancyMap) -> OccupancyMap:
    """A map without rooms."""
    return replace(grid_map, rooms=np.full_like(grid_map.rooms, -1), room_names=())


def has(picture: np.ndarray, rgb: tuple[int, int, int], tolerance: int = 12) -> bool:
    """Whether any pixel is about that color."""
    return bool((np.abs(picture.astype(int) - rgb).max(-1) <= tolerance).any())


def test_the_picture_shows_the_way_from_start_to_end() -> None:
    """Early and late colors of the way appear where the base was at those times, and nowhere without a drive."""
    poses = np.linspace([1.0, 2.0, 0.0], [7.0, 2.0, 0.0], 200)
    driven, parked = (
        path_picture(two_rooms(), poses, R1.base.outline),
        path_picture(two_rooms(), poses[:1], R1.base.outline),
    )
    early, late = (60, 5, 150), (245, 180, 50)
    column = driven.shape[1] // 8  # a meter of the map
    way = driven[: -driven.shape[0] // 8]  # without the bar that explains the colors
    assert has(way[:, column : 3 * column], early, 60)
    assert has(way[:, 5 * column : 7 * column], late, 60)
    assert not has(way[:, : 4 * column], late, 20)
    assert not has(parked, late, 20)


def test_north_is_up_in_the_picture() -> None:
    """What lies at a greater y of the world is drawn higher."""

    def row_of_end(y: float) -> float:
        picture = path_picture(two_rooms(), np.array([[6.0, 2.0, 0.0], [1.0, y, 0.0]]), R1.base.outline)
        red = np.argwhere(np.abs(picture.astype(int) - (200, 40, 50)).max(-1) < 20)
        return float(np.median(red[:, 0]))

    assert row_of_end(3.4) < row_of_end(0.6)


def test_moved_objects_are_marked_and_others_are_not() -> None:
    """An arrow's color appears only if something went somewhere."""
    poses, orange = np.array([[1.0, 2.0, 0.0]]), (240, 120, 20)
    can, moved = {"can": np.array([2.0, 3.0])}, {"can": np.array([6.0, 3.0])}
    assert has(path_picture(two_rooms(), poses, R1.base.outline, can, moved), orange)
    assert not has(path_picture(two_rooms(), poses, R1.base.outline, can, can), orange)


def test_goals_are_marked_where_they_are() -> None:
    """A mark of their color at the pose, and none without."""
    poses, teal = np.array([[1.0, 2.0, 0.0]]), (20, 110, 150)
    marked = path_picture(two_rooms(), poses, R1.base.outline, goals=[np.array([6.0, 2.0, 0.0])])
    assert has(marked[:, marked.shape[1] // 2 :], teal)
    assert not has(path_picture(two_rooms(), poses, R1.base.outline), teal)


def test_the_picture_of_a_search_shows_what_was_seen_and_found() -> None:
    """Unseen floor is darker than seen floor of the same room; frontiers and finds have marks, and only then."""
    poses = np.array([[1.0, 2.0, 0.0]])
    search = MadeUpSearch(entries=[find("can", 6.0, 3.0)])
    search.frontier[20:60, 39] = True
    picture = path_picture(two_rooms(), poses, R1.base.outline, search=search)
    meter = picture.shape[1] / 8
    seen, unseen = (picture[round(meter) :, round(x * meter)].astype(int)[: round(2 * meter)] for x in (0.7, 3.0))
    assert np.median(seen.sum(-1)) > np.median(unseen.sum(-1)) + 60
    assert has(picture[:, round(1.8 * meter) : round(2.1 * meter)], colors.FRONTIER)
    assert has(picture[: round(1.5 * meter), round(5.8 * meter) : round(6.2 * meter)], colors.FOUND)
    without = path_picture(two_rooms(), poses, R1.base.outline)
    assert not has(without, colors.FRONTIER)
    assert not has(without, colors.FOUND)


def test_the_picture_of_a_map_that_was_built_shows_what_is_known_of_it() -> None:
    """It is as large as that, not as the grid."""
    search = MadeUpSearch()
    search.known[:, 80:] = False
    picture = path_picture(
        two_rooms(), np.array([[1.0, 2.0, 0.0]]), R1.base.outline, search=replace(search, map=unlabeled(search.map))
    )
    height, width = picture.shape[:2]
    assert width < 1.6 * height


def test_the_video_of_a_search_shows_its_map(tmp_path: Path) -> None:
    """Under the views, with the colors of the search; the film is as long as any other."""
    world, file = VisibleWorld(), tmp_path / "episode.mp4"
    watch(world, Video(file, "waiting", frames_per_s=5, speed=1, search=MadeUpSearch()), spec=WAITING)
    shown = frames(file)
    card, shown = shown[0], shown[6 * 5 :]
    assert len(shown) == 2 * 5 + 1 + 5
    assert has(shown[0][:300, :400], (20, 200, 20), 30)
    assert has(shown[0][300:, :800], colors.SEEN)
    assert has(shown[0][300:, :800], colors.ROBOT, 30)
    assert has(card[-80:], colors.FOUND, 30), "the colors are told once"
    assert not has(shown[0][:, 800:], colors.FOUND, 30)


def test_an_episode_leaves_its_picture_even_when_interrupted(tmp_path: Path) -> None:
    """The file is there after Ctrl-C, in a folder that was not."""
    base = KnowledgeBase()
    base.put(thing("can", (2.0, 3.0, 0.06), (0.07, 0.07, 0.12)))
    file = tmp_path / "new" / "path.png"
    with pytest.raises(KeyboardInterrupt):
        watch(KinematicWorld(), PathPicture(file, two_rooms(), lambda: base, lambda: np.zeros(3)), Interrupting())
    picture = cv2.imread(str(file))
    assert picture is not None
    assert picture.shape[2] == 3


def test_the_video_plays_with_a_frame_for_every_so_many_steps(tmp_path: Path) -> None:
    """Two seconds at five frames a second, the last state for a second more; the outside view is in it."""
    world, file = VisibleWorld(), tmp_path / "new" / "episode.mp4"
    watch(world, Video(file, "waiting", frames_per_s=5, speed=1), spec=WAITING)
    shown = frames(file)
    shown = shown[6 * 5 :]  # after the card
    assert len(shown) == 2 * 5 + 1 + 5
    assert shown[0].shape == (SIZE[1], SIZE[0], 3)
    assert has(shown[0][:500, :700], (20, 200, 20), 30)
    assert world.looks == len(shown)


def test_a_video_of_a_plan_begins_with_it_and_passes_over_drives(tmp_path: Path) -> None:
    """Six seconds of a card without a picture of the world, then half as many frames of two seconds of driving."""
    world, file = VisibleWorld(), tmp_path / "episode.mp4"
    watch(world, Video(file, "picking_up_trash", frames_per_s=5, speed=1), can_m=9.0)
    shown = frames(file)
    assert [has(frame[:500, :700], (20, 200, 20), 30) for frame in shown] == [False] * 6 * 5 + [True] * (5 + 1 + 5)


def test_a_video_ends_with_the_goal() -> None:
    """Each condition in the color of its mark; without a goal there is no such card."""
    met, missed = INKS["success"], INKS["failure"]
    report = GoalReport(False, 0.5, 0.5, (GoalCondition("a is in b", True), GoalCondition("c is on d", False)))
    card = closing(Outcome("success", 12.0, goal=report), SPEC)
    assert card is not None
    assert has(card, met)
    assert has(card, missed)
    assert closing(Outcome("success", 12.0), SPEC) is None


def test_a_plan_of_any_length_fits_its_card() -> None:
    """Nothing is written on the margin of a card, however many units there are and however long the words."""
    units = "".join(f"\n  - {{attempt: {'carry it on ' * 20}{i}, child: {{wait: 1}}}}" for i in range(90))
    spec = parse_tree(f"tree: long\nroot:\n  sequence: long\n  memory: true\n  children:{units}\n", "long.yaml")
    card = opening("x" * 200, "y" * 300, replace(spec, instruction="very " * 300 + "long"))
    assert card is not None
    inner = card.copy()
    inner[8:-8, 32:-32] = card[0, 0]
    assert (inner == card[0, 0]).all()


@pytest.mark.parametrize("met", [True, False, None])
def test_only_films_of_failures_are_kept(tmp_path: Path, met: bool | None) -> None:
    """Where the goal is met neither film nor poster is left, of an earlier attempt neither; else both are."""
    file = tmp_path / "episode.mp4"
    file.with_suffix(".poster.jpg").write_bytes(b"of an earlier attempt")
    video, world = Video(file, frames_per_s=2, only_failures=True), VisibleWorld()
    tree = Tree(WAITING)
    video.start(tree, world)
    video.step(tree, world)
    goal = None if met is None else GoalReport(met, float(met), float(met), (GoalCondition("a is in b", met),))
    video.end(Outcome("success" if met else "interrupted", goal=goal))
    assert [path.name for path in sorted(tmp_path.iterdir())] == ([] if met else ["episode.mp4", "episode.poster.jpg"])
    assert met or len(frames(file)) >= 2


@pytest.mark.parametrize("how", ["at once", "in the end"])
def test_a_full_disk_ends_the_film_and_not_the_episode(
    tmp_path: Path, how: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """One line says so; the tree runs to its end, and no film that cannot be played goes unnoticed."""
    file = tmp_path / "episode.mp4"
    file.symlink_to("/dev/full")
    said: list[str] = []
    video = Video(file, frames_per_s=30 if how == "at once" else 0.5, tell=said.append)
    world = VisibleWorld()
    watch(world, video, spec=WAITING)
    assert world.steps == 60  # two seconds, as without a film
    (line,) = said
    assert line.startswith(f"{file}: ")
    assert "is the disk full?" in line
    assert capfd.readouterr().err == ""  # ffmpeg's own words would be five lines


def test_whether_a_film_can_be_played_is_told_by_its_parts(tmp_path: Path) -> None:
    """A whole film has its index; one that was cut anywhere, or is none, has not, or is too short."""
    file, cut = tmp_path / "episode.mp4", tmp_path / "cut.mp4"
    watch(VisibleWorld(), Video(file, frames_per_s=2), spec=WAITING)
    whole = file.read_bytes()
    assert has_index(file)
    for length in (0, 4, 8, 100, len(whole) // 2, len(whole) - 1):
        cut.write_bytes(whole[:length])
        assert not has_index(cut)


def test_after_ctrl_c_the_video_plays(tmp_path: Path) -> None:
    """The index is written, without which no player opens the file."""
    file = tmp_path / "episode.mp4"
    with pytest.raises(KeyboardInterrupt):
        watch(KinematicWorld(), Video(file, frames_per_s=2), Interrupting())
    assert len(frames(file)) >= 2


def test_a_file_that_cannot_be_written_is_a_user_error(tmp_path: Path) -> None:
    """Said before the episode begins, with the path."""
    (tmp_path / "file").write_text("")
    bad = tmp_path / "file" / "episode.mp4"
    with pytest.raises(UserError, match="cannot be written"):
        watch(KinematicWorld(), Video(bad))


def test_a_long_tree_leaves_the_frame_in_order() -> None:
    """Lines that do not fit are counted, not drawn over what is below; the node in force is among those that do."""
    head = np.zeros((240, 320, 3), np.uint8)
    tree = [Line(f"n{i}", "running" if i == 200 else None, f"line {i}", "", "") for i in range(300)]
    frame = compose(None, head, Caption(tree=tree, at="n200"))
    assert frame.shape == (SIZE[1], SIZE[0], 3)
    assert has(frame[:-60, 800:], BAR, 0)


def test_the_following_camera_looks_at_the_robot_and_stays_upright() -> None:
    """Wherever the base goes, it is near the middle of the picture, and the picture's down is down."""
    follow, rng = Follower(), np.random.default_rng(0)
    pose = np.array([3.0, 2.0, 1.0])
    for _ in range(200):
        pose = pose + rng.normal(0, (0.05, 0.05, 0.1))
        T = follow(pose)
        np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-9)
        assert T[2, 1] < 0  # y of the picture points down
        seen = np.linalg.inv(T) @ np.array([pose[0], pose[1], 0.7, 1.0])
        assert seen[2] > 0.5
        assert np.abs(seen[:2] / seen[2]).max() < 0.55


def test_films_draw_the_signs_of_trees() -> None:
    """Each sign of a node and mark of a state is drawn as itself: none is left out, no two look alike."""
    drawn: dict[str, bytes] = {}
    for icon in sorted(ICONS):
        frame = np.zeros((30, 30, 3), np.uint8)
        write(frame, plain(icon), (10, 20), (255, 255, 255))
        assert frame.any(), icon
        drawn[icon] = frame.tobytes()
    assert len(set(drawn.values())) == len(drawn)
    signs = {character for text in LEGEND for character in text if not character.isascii()}
    assert signs <= ICONS
    spec = parse_tree(
        "tree: t\nroot:\n  selector: s\n  memory: true\n  children: [{retry: 2, child: {wait: 1}}, {wait: 2}]\n"
    )
    assert all("?" not in plain(line.text).replace("?*", "") for line in tree_lines(spec, {}, 59, unicode=True))


def test_people_read_no_synsets() -> None:
    """Names of things are said in words, with their number where there are several of them."""
    assert spoken("can__of__soda.n.01_1") == "can of soda"
    assert spoken("countertop_2") == "countertop"
    assert list(spoken_each(["cup.n.01_1", "cup.n.01_2", "tray.n.01_1"]).values()) == ["cup 1", "cup 2", "tray"]
    assert spoken_texts(["inside(can__of__soda.n.01_1, ashcan.n.01_1)", "not open(ashcan.n.01_1)"]) == [
        "inside(can of soda, ashcan)",
        "not open(ashcan)",
    ]


def test_a_house_is_named_where_its_things_are() -> None:
    """Names do not overlap; one alone is over its thing; what is behind the camera has none."""
    picture = np.zeros((480, 640, 3), np.uint8)
    camera = look_at((0.0, 0.0, 10.0), (0.0, 0.0, 0.0))

    def cube(x: float, y: float, z: float = 0.0) -> Array:
        return np.array([[x, y, z], [x + 0.2, y + 0.2, z + 0.2]])

    things = [(f"thing {k}", cube(*place)) for k, place in enumerate(np.random.default_rng(0).uniform(-1, 1, (60, 2)))]
    taken = name_things(picture, camera, 0.6, [("behind", cube(0, 0, 20)), *things])
    assert 5 < len(taken) < 60
    for i, (a, b, c, d) in enumerate(taken):
        assert all(c <= e or g <= a or d <= f or h <= b for e, f, g, h in taken[:i])
    ((a, b, c, d),) = name_things(picture.copy(), camera, 0.6, [("table", cube(-0.1, -0.1))])
    assert a < 320 < c
    assert b < 240 < d


def test_the_walls_before_rooms_are_near() -> None:
    """Of a house of one room the south wall hides it, from the inside and from the outside; the others do not."""
    house = small_house()
    near = [wall for wall in house.walls if is_near(wall, house)]
    assert {wall.room for wall in near} == {wall.room for wall in house.walls}
    assert all(wall.solid.aabb()[:, 1].mean() < -2.8 for wall in near)
    assert 0 < len(near) < len(house.walls)


def test_labels_of_a_picture_cover_neither_one_another_nor_the_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    """However near each other start, end, goals and things are."""
    every: list[Any] = []

    class Kept(Labels):
        def __init__(self, picture: Picture, size: float = 0.42) -> None:
            super().__init__(picture, size)
            self.written: list[Rectangle] = []
            every.append(self)

        def _write(self, text: str, at: tuple[int, int], place: Rectangle, *inks: Any) -> None:
            self.written.append(place)
            super()._write(text, at, place, *inks)

    monkeypatch.setattr("mpvi_bt.runs.recording.map_canvas.Labels", Kept)
    poses = np.array([[1.0, 2.0, 0.0], [1.1, 2.1, 0.0], [1.3, 2.0, 1.0]])
    things = {f"can__of__soda.n.01_{k}": np.array([1.4 * k, 0.8 + 0.2 * k]) for k in range(1, 5)}
    path_picture(two_rooms(), poses, R1.base.outline, things, things, list(poses))
    small, rooms = every
    texts = [*small.written, *rooms.written]
    assert len(texts) > 6
    for k, (a, b, c, d) in enumerate(texts):
        assert all(c <= e or g <= a or d <= f or h <= b for e, f, g, h in texts[:k])
    taken = small.taken
    assert len(taken) == len(texts) + 2 + len(poses)  # and start, end and goals, which no text covers
