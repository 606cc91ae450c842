"""Laws of the pictures of searches: the map from above and the frames of a film."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.finding.perception.detector import ROBOT
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.hands.robots.r1 import R1
from mpvi_bt.runs.recording import search_colors as colors
from mpvi_bt.runs.recording.frame_text import SIZE, Caption
from mpvi_bt.runs.recording.labels import Color, Labels, Picture
from mpvi_bt.runs.recording.map_picture import MapPicture
from mpvi_bt.runs.recording.search_frames import SearchFrames
from mpvi_bt.runs.recording.search_view import SearchView, Window, found, seen_m2, visible
from tests.navigation_maps import thing
from tests.search_views import MadeUpSearch, box, find, look

POSE = np.array([1.0, 2.0, 0.0])
SCALE = 100  # pixels a meter of the pictures below; all of the map is shown


def draw(search: SearchView, **more: Any) -> Picture:
    """The two rooms, 8 m by 4 m."""
    return MapPicture((8 * SCALE, 4 * SCALE)).draw(search, POSE, R1.base.outline, **more)


def at(picture: Picture, x: float, y: float, radius_px: int = 6) -> Picture:
    """The pixels about a place [m]."""
    u, v = round(x * SCALE), picture.shape[0] - round(y * SCALE)
    return picture[v - radius_px : v + radius_px, u - radius_px : u + radius_px]


def has(picture: Picture, color: Color) -> bool:
    """Whether any pixel has exactly that color."""
    return bool((picture == color).all(-1).any())


def test_search_views_are_search_views() -> None:
    """The double of these tests is what the pictures ask for."""
    view: SearchView = MadeUpSearch()
    assert view.map.occupied.shape == view.seen.shape


def test_seen_unseen_and_unknown_floor_look_different() -> None:
    """Each has its color where it is, walls theirs."""
    search = MadeUpSearch()
    search.known[:, 120:] = False
    picture = draw(search)
    assert has(at(picture, 0.6, 3.2), colors.SEEN)
    assert has(at(picture, 3.0, 3.5), colors.UNSEEN)
    assert has(at(picture, 7.0, 1.0), colors.UNKNOWN)
    assert has(at(picture, 4.0, 3.5, 3), colors.WALL)
    assert not has(at(picture, 0.6, 3.2), colors.UNSEEN)


def test_north_is_up_on_the_map() -> None:
    """What was found at a greater y of the world is drawn higher."""
    picture = draw(MadeUpSearch(entries=[find("can", 1.0, 3.5)]))
    rows = np.nonzero((picture == colors.FOUND).all(-1))[0]
    assert rows.size
    assert rows.max() < picture.shape[0] / 4


def test_what_the_search_does_is_drawn_where_it_does_it() -> None:
    """Frontier, path, goal, way and robot have their colors there, and no pixel has them without."""
    search = MadeUpSearch()
    bare = draw(search)
    assert has(at(bare, 1.0, 2.0, 30), colors.ROBOT)
    for color in (colors.FRONTIER, colors.PATH, colors.WAY, colors.FOUND):
        assert not has(bare, color)
    frontier = np.zeros_like(search.seen)
    frontier[40:60, 39] = True
    full = replace(search, frontier=frontier, path=np.array([[1.0, 2.0], [3.0, 1.0]]), goal=np.array([3.0, 1.0, 0.0]))
    picture = draw(full, way=[np.array([0.5, 0.5]), np.array([0.5, 2.0])])
    assert has(at(picture, 1.98, 2.5), colors.FRONTIER)
    assert has(at(picture, 2.0, 1.5), colors.PATH)
    assert has(at(picture, 3.0, 1.0, 30), colors.PATH)
    assert has(at(picture, 0.5, 1.0), colors.WAY)


def test_only_what_was_found_by_looking_counts_as_found() -> None:
    """Neither what is known beforehand, nor what was never seen, nor what is hardly believed in any more."""
    entries = [
        find("can", 1, 1),
        find("sofa", 1, 1, source="prior"),
        find("cup", 1, 1, seen_s=None),
        find("fork", 1, 1, confidence=0.1),
        thing("table", (1, 1, 1), (1, 1, 1)),
    ]
    assert [entry.name for entry in found(entries)] == ["can"]


def test_the_visible_area_ends_at_walls() -> None:
    """From the kitchen the living room is in view through the door alone, and nothing behind the robot is."""
    search = MadeUpSearch()
    corners = visible(search.map, look(1.0, 2.0, 0.0), reach_m=6.0)
    assert corners[:, 0].min() > 0.99
    beyond = corners[corners[:, 0] > 4.1]
    assert len(beyond)
    assert np.abs(beyond[:, 1] - 2.0).max() < 0.45 * 6 / 3 + 0.1
    picture = draw(replace(search, seen=~search.map.occupied), image=look(1.0, 2.0, 0.0))
    assert has(at(picture, 2.5, 2.0), colors.IN_VIEW)
    assert not has(at(picture, 0.4, 2.0), colors.IN_VIEW)
    assert not has(at(picture, 6.0, 3.5), colors.IN_VIEW)


def test_a_map_that_is_built_stays_in_place_until_it_outgrows_its_picture() -> None:
    """The same cells are shown while what is known grows within them, and never fewer than before."""
    grid = OccupancyMap(np.ones((400, 400), bool), np.full((400, 400), -1, np.int16), (), 0.05, np.full(2, -10.0))
    seen, frontier = np.zeros((400, 400), bool), np.zeros((400, 400), bool)
    search = MadeUpSearch(grid, seen, seen, frontier)
    window = Window()
    shown = []
    for half in (25, 28, 60, 10):
        grid.occupied[:] = True
        grid.occupied[200 - half : 200 + half, 200 - half : 200 + half] = False
        search.known = ~grid.occupied
        shown.append(window.of(search))
    assert shown[0] == shown[1]
    assert shown[2] == shown[3] != shown[0]


@pytest.mark.parametrize("known", [True, False])
def test_there_is_a_picture_of_any_search(known: bool) -> None:
    """Of one that knows nothing yet, stands outside its map, and has things, goals and boxes outside as well."""
    search = MadeUpSearch(
        path=np.zeros((1, 2)),
        goal=np.array([50.0, -50.0, 9.0]),
        image=look(-30.0, 2.0, 1.0),
        entries=[find("can", 90, 90)],
    )
    search.known[:] = known
    assert draw(search, image=search.image).shape == (4 * SCALE, 8 * SCALE, 3)
    assert MapPicture((31, 17)).draw(search, np.array([1e3, -1e3, 0.0]), R1.base.outline).shape == (17, 31, 3)


def test_areas_are_told_in_square_meters() -> None:
    """Of floor alone; where the map is built on the way nobody knows how much there is in all."""
    search = MadeUpSearch()
    seen, total = seen_m2(search)
    assert seen == pytest.approx((search.seen & ~search.map.occupied).sum() * 0.0025)
    assert total == pytest.approx((~search.map.occupied).sum() * 0.0025)
    search.known[0] = False
    assert seen_m2(search)[1] is None


places = st.tuples(st.integers(-20, 320), st.integers(-20, 240))


@given(st.lists(st.tuples(places, st.text("abc ", min_size=1, max_size=12)), max_size=30))
def test_no_two_texts_cover_one_another(given: list[tuple[tuple[int, int], str]]) -> None:
    """Nor do they leave the picture."""
    labels = Labels(np.zeros((240, 320, 3), np.uint8))
    written = [labels.beside((u, v, u + 9, v + 9), text, colors.INK) for (u, v), text in given]
    assert sum(written) == len(labels.taken)
    covered = np.zeros((240, 320), int)
    for left, top, right, bottom in labels.taken:
        assert 0 <= left < right <= 320
        assert 0 <= top < bottom <= 240
        covered[top:bottom, left:right] += 1
    assert covered.max(initial=0) <= 1


class Still:
    """A world in which nothing moves; its head sees gray."""

    def __init__(self) -> None:
        self.time_s, self.looks = 0.0, 0
        self.robot = SimpleNamespace(proprioception=lambda: SimpleNamespace(base_pose=POSE, robot="r1"), look=self.look)

    def look(self, camera: str) -> Any:
        """Lighter than the pictures that were searched."""
        assert camera == "head"
        self.looks += 1
        return look(1.0, 2.0, 0.0, shade=200)


def head(frame: Picture) -> Picture:
    """The head's picture in a frame."""
    return frame[:300, 400:800]


def shoot(frames: SearchFrames, world: Still, time_s: float) -> Picture:
    """The frame of a time."""
    world.time_s = time_s
    return frames.frame(None, world, Caption("title", ["1 s"]))  # type: ignore[arg-type]


def test_detections_are_boxed_in_the_picture_that_they_were_made_in() -> None:
    """While it is fresh, without another rendering; afterward the head's present picture has no boxes."""
    world, search = Still(), MadeUpSearch(image=look(1.0, 2.0, 0.0), detections=[box("can", 100, 100, 140, 150)])
    frames = SearchFrames(search)
    frame = shoot(frames, world, 10.0)
    assert frame.shape == (SIZE[1], SIZE[0], 3)
    rows, columns = np.nonzero((head(frame)[130:] == colors.THINGS[0]).all(-1))
    assert columns.min() == pytest.approx(125, abs=3)
    assert columns.max() == pytest.approx(175, abs=3)
    assert rows.max() + 130 == pytest.approx(187, abs=3)
    assert has(head(frame), (90, 90, 90))
    assert has(head(shoot(frames, world, 10.4)), colors.THINGS[0])
    assert world.looks == 0
    later = head(shoot(frames, world, 11.0))
    assert (later == 200).all()
    assert world.looks == 1
    search.image = look(1.0, 2.0, 0.0)
    assert has(head(shoot(frames, world, 11.2)), colors.THINGS[0])


def test_the_robots_own_parts_are_not_boxed() -> None:
    """They are no find."""
    search = MadeUpSearch(image=look(1.0, 2.0, 0.0), detections=[box(ROBOT, 0, 200, 320, 240)])
    assert (head(shoot(SearchFrames(search), Still(), 0.0)) == 90).all()


def test_a_phrase_keeps_its_color() -> None:
    """Whatever else is detected beside it, and before it."""
    search, world = MadeUpSearch(image=look(1.0, 2.0, 0.0)), Still()
    frames = SearchFrames(search)
    search.detections = [box("can", 100, 100, 140, 150)]
    shoot(frames, world, 0.0)
    search.detections = [box("bin", 10, 100, 60, 150, score=1.0), box("can", 100, 100, 140, 150)]
    frame = head(shoot(frames, world, 0.1))
    assert has(frame[125:190, 125:180], colors.THINGS[0])
    assert has(frame[125:190, 12:80], colors.THINGS[1])
