"""Shapes from the visible points of one thing."""

from __future__ import annotations

import numpy as np
import pytest

from mpvi_bt.finding.shapes.fit import fit
from mpvi_bt.finding.shapes.outlines import circle, main_cluster, outline, support_height, thinned
from mpvi_bt.finding.shapes.shape import Shape
from mpvi_bt.ground.geometry.solids import Array, Solid, box, pose
from mpvi_bt.ground.robot.collision import Surroundings

EYE = np.array([-0.7, 0.0, 1.4])
LEVEL_M = 0.6


def visible(solids: list[Solid], eye: Array, step: float = 0.003) -> Array:
    """(n, 3) surface points of boxes, upright cylinders and balls whose normals turn toward the eye."""
    out = []
    for s in solids:
        x, _, z = s.half_m
        if s.kind == "sphere":
            u, v = np.meshgrid(np.arange(0, 2 * np.pi, 0.1), np.arange(-1.5, 1.51, 0.1))
            n = np.stack([np.cos(u) * np.cos(v), np.sin(u) * np.cos(v), np.sin(v)], -1).reshape(-1, 3)
            p = n * x
        elif s.kind == "cylinder":
            u, h = np.meshgrid(np.arange(0, 2 * np.pi, step / x), np.arange(-z, z + 1e-6, step))
            n = np.stack([np.cos(u), np.sin(u), 0 * u], -1).reshape(-1, 3)
            p = n * [x, x, 0] + np.stack([0 * h, 0 * h, h], -1).reshape(-1, 3)
            r, a = np.meshgrid(np.arange(0, x, step), np.arange(0, 2 * np.pi, 0.1))
            lid = np.stack([r * np.cos(a), r * np.sin(a), 0 * r + z], -1).reshape(-1, 3)
            p, n = np.concatenate([p, lid]), np.concatenate([n, np.tile([0, 0, 1.0], (len(lid), 1))])
        else:
            p, n = np.zeros((0, 3)), np.zeros((0, 3))
            for k in range(3):
                i, j = (k + 1) % 3, (k + 2) % 3
                a, b = np.meshgrid(*(np.arange(-s.half_m[m], s.half_m[m] + 1e-9, step) for m in (i, j)))
                for sign in (-1, 1):
                    q = np.zeros((a.size, 3))
                    q[:, i], q[:, j], q[:, k] = a.ravel(), b.ravel(), sign * s.half_m[k]
                    normal = np.zeros(3)
                    normal[k] = sign
                    p, n = np.concatenate([p, q]), np.concatenate([n, np.tile(normal, (len(q), 1))])
        p, n = p @ s.T[:3, :3].T + s.T[:3, 3], n @ s.T[:3, :3].T
        out.append(p[((eye - p) * n).sum(1) > 0.05 * np.linalg.norm(eye - p, axis=1)])
    return np.concatenate(out)


def table(level: float = LEVEL_M) -> Array:
    x, y = np.meshgrid(np.arange(-0.3, 0.3, 0.01), np.arange(-0.3, 0.3, 0.01))
    return np.stack([x, y, 0 * x + level], -1).reshape(-1, 3)


def upright(kind: str, half: tuple[float, float, float], yaw: float = 0.4) -> Solid:
    return Solid(kind, np.array(half), pose((0.02, 0.03, LEVEL_M + half[2]), yaw))  # type: ignore[arg-type]


def noisy(points: Array, rng: np.random.Generator) -> Array:
    """What a median over nine pixels leaves of depth noise of 3 mm times range squared, along the line of sight."""
    ray = points - EYE
    far = np.linalg.norm(ray, axis=1, keepdims=True)
    return points + ray / far * far**2 * 0.0013 * rng.standard_normal((len(points), 1))


def close(shape: Shape | None, solid: Solid, tolerance_m: float) -> None:
    assert shape is not None
    np.testing.assert_allclose(shape.box(), solid.aabb(), atol=tolerance_m)


THINGS = {
    "book": upright("box", (0.10, 0.07, 0.015)),
    "carton": upright("box", (0.035, 0.035, 0.10)),
    "long box": upright("box", (0.06, 0.02, 0.03)),
    "can": upright("cylinder", (0.033, 0.033, 0.061)),
    "tin": upright("cylinder", (0.042, 0.042, 0.02)),
    "candle": upright("cylinder", (0.015, 0.015, 0.09)),
    "ball": upright("sphere", (0.034, 0.034, 0.034)),
    "golf ball": upright("sphere", (0.0215, 0.0215, 0.0215)),
}
KINDS = {"box": "box", "cylinder": "cylinder", "sphere": "ball"}


@pytest.mark.parametrize("name", THINGS)
def test_a_thing_seen_from_one_side_is_known_whole(name: str) -> None:
    """Kind, place and extent of boxes, cylinders and balls follow from what one look from above and before shows."""
    solid = THINGS[name]
    shape = fit(visible([solid], EYE), hidden_behind(table(), [solid], EYE), EYE)
    assert shape is not None
    assert shape.kind == KINDS[solid.kind]
    close(shape, solid, 0.005)


@pytest.mark.parametrize("name", THINGS)
def test_noise_of_depth_moves_a_shape_little(name: str) -> None:
    """With the noise that is left of a depth camera's, middles stay within 4 mm and extents within 8 mm."""
    solid, rng = THINGS[name], np.random.default_rng(0)
    around = hidden_behind(table(), [solid], EYE)
    for _ in range(5):
        shape = fit(noisy(visible([solid], EYE), rng), noisy(around, rng), EYE)
        assert shape is not None
        np.testing.assert_allclose(shape.box().mean(0), solid.aabb().mean(0), atol=0.004)
        np.testing.assert_allclose(np.ptp(shape.box(), axis=0), np.ptp(solid.aabb(), axis=0), atol=0.008)


@pytest.mark.parametrize("turn", [-0.6, 0.0, 0.6])
def test_half_a_pie_is_no_whole_one(turn: float) -> None:
    """A round side toward the viewer is no cylinder where what it stands on shows behind: no hand spans a whole pie."""
    edges = np.linspace(-0.08, 0.08, 17)
    reach = np.sqrt(0.08**2 - (edges[:-1] + 0.005) ** 2)
    T = pose((0.02, 0.03, LEVEL_M), turn)
    half = [box((-x / 2, y + 0.005, 0.022), (x, 0.01, 0.044)).moved(T) for x, y in zip(reach, edges, strict=False)]
    points = hidden_behind(visible(half, EYE), half, EYE)
    shape = fit(points, hidden_behind(table(), half, EYE), EYE)
    assert shape is not None
    assert shape.kind == "box"
    np.testing.assert_allclose(np.sort(shape.solids[0].half_m)[1:] * 2, [0.08, 0.16], atol=0.008)


def test_a_box_whose_top_is_out_of_sight_is_aligned_with_its_sides() -> None:
    """Of a carton on a high shelf two sides show; the box around them is the carton, not the one across its corner."""
    eye, solid = np.array([-0.7, 0.0, LEVEL_M + 0.02]), upright("box", (0.035, 0.035, 0.10), yaw=0.7)
    close(fit(visible([solid], eye), np.zeros((0, 3)), eye), solid, 0.006)


def test_of_a_single_side_the_depth_is_guessed_behind_it() -> None:
    """A box of which only the front shows extends away from the viewer, by its width but no more than a hand spans."""
    eye, solid = np.array([-0.7, 0.03, LEVEL_M + 0.02]), upright("box", (0.02, 0.03, 0.10), yaw=0.0)
    front = visible([solid], eye)
    front = front[front[:, 0] < 0.001]
    shape = fit(front, np.zeros((0, 3)), eye)
    assert shape is not None
    assert shape.box()[0, 0] == pytest.approx(0.0, abs=0.004)
    assert 0.05 < np.ptp(shape.box()[:, 0]) <= 0.081


def bowl(radius: float, height: float, wall: float = 0.008) -> list[Solid]:
    out = [upright("cylinder", (radius, radius, wall / 2))]
    for angle in np.arange(24) * np.pi / 12:
        at = pose((0.02 + (radius - wall / 2) * np.cos(angle), 0.03 + (radius - wall / 2) * np.sin(angle), 0), angle)
        at[2, 3] = LEVEL_M + height / 2
        out.append(Solid("box", np.array([wall / 2, radius * np.tan(np.pi / 24), height / 2]), at))
    return out


def crate(x: float, y: float, z: float, yaw: float, bar: bool) -> list[Solid]:
    wall = 0.008
    parts = [box((0, 0, wall / 2), (x, y, wall))]
    for sign in (-1, 1):
        parts.append(box((sign * (x - wall) / 2, 0, z / 2), (wall, y, z)))
        parts.append(box((0, sign * (y - wall) / 2, z / 2), (x, wall, z)))
        if bar:
            parts.append(box((0, sign * (y / 2 - 0.004), z + 0.03), (0.016, 0.008, 0.06)))
    if bar:
        parts.append(box((0, 0, z + 0.07), (0.016, y, 0.02)))
    return [p.moved(pose((0.02, 0.03, LEVEL_M), yaw)) for p in parts]


def hidden_behind(points: Array, solids: list[Solid], eye: Array) -> Array:
    """Those of the points that no solid hides from the eye."""
    keep = np.ones(len(points), bool)
    for u in np.linspace(0.004, 0.5, 60):
        between = points + (eye - points) * u
        for s in solids:
            local = np.abs((between - s.T[:3, 3]) @ s.T[:3, :3]) - s.half_m
            keep &= ~(local < -1e-4).all(1)
    return points[keep]


@pytest.mark.parametrize(("radius", "height"), [(0.08, 0.06), (0.11, 0.09), (0.09, 0.03)])
def test_a_bowl_is_a_round_vessel(radius: float, height: float) -> None:
    """A bowl has walls that a hand can pinch and an inside that things fall into."""
    solids = bowl(radius, height)
    points = hidden_behind(visible(solids, EYE, 0.004), solids, EYE)
    shape = fit(points, table(), EYE)
    assert shape is not None
    assert shape.kind == "vessel"
    (volume,) = shape.volumes
    assert volume.kind == "cylinder"
    assert volume.half_m[0] == pytest.approx(radius - 0.008, abs=0.005)
    np.testing.assert_allclose(shape.box().mean(0), [0.02, 0.03, LEVEL_M + height / 2], atol=0.006)


@pytest.mark.parametrize("yaw", [0.0, 0.5, 1.2])
@pytest.mark.parametrize("bar", [False, True])
def test_a_crate_is_a_square_vessel_and_its_bail_a_bar(yaw: float, bar: bool) -> None:
    """Walls, inside and, if there is one, the bar above the rim are found, whichever way it stands."""
    solids = crate(0.34, 0.28, 0.30, yaw, bar)
    eye = EYE + [-0.2, 0, 0]
    shape = fit(hidden_behind(visible(solids, eye, 0.008), solids, eye), table(), eye)
    assert shape is not None
    assert shape.kind == "vessel"
    (volume,) = shape.volumes
    np.testing.assert_allclose(np.sort(volume.half_m[:2]) * 2, [0.264, 0.324], atol=0.02)
    np.testing.assert_allclose(volume.T[:2, 3], [0.02, 0.03], atol=0.01)
    assert volume.aabb()[1, 2] == pytest.approx(LEVEL_M + 0.30, abs=0.01)
    assert len(shape.bars) == bar
    for found in shape.bars:
        np.testing.assert_allclose(found.center, [0.02, 0.03, LEVEL_M + 0.37], atol=0.012)
        assert abs(found.axis @ [-np.sin(yaw), np.cos(yaw), 0]) > 0.98


@pytest.mark.parametrize("yaw", [0.0, 2.5])
def test_what_has_a_lid_above_what_stands_out_from_it_is_no_vessel(yaw: float) -> None:
    """Spout and handle of a kettle reach farther than its body, and its lid higher than both: it covers the opening."""
    rounds = ((0.041, 0.15, 0.075), (0.035, 0.014, 0.157), (0.01, 0.014, 0.171))
    round_ = [Solid("cylinder", np.array([r, r, h / 2]), pose((0, 0, z))) for r, h, z in rounds]
    boxes = (((-0.05, 0, 0.132), (0.03, 0.026, 0.03)), ((0.07, 0, 0.09), (0.014, 0.018, 0.11)),
             ((0.05, 0, 0.14), (0.044, 0.018, 0.012)))  # fmt: skip
    solids = [s.moved(pose((0.02, 0.03, LEVEL_M), yaw)) for s in (*round_, *(box(at, size) for at, size in boxes))]
    shape = fit(hidden_behind(visible(solids, EYE), solids, EYE), hidden_behind(table(), solids, EYE), EYE)
    assert shape is not None
    assert shape.kind != "vessel"


def test_a_wide_basket_on_the_floor_is_a_vessel_though_a_part_of_its_rim_is_hidden() -> None:
    """Not furniture with a board over what lies in it; a low bench of that size is furniture."""
    sunk = pose((0.0, 0.0, -LEVEL_M))
    solids = [solid.moved(sunk) for solid in crate(0.62, 0.42, 0.11, 0.9, False)]
    eye = np.array([-0.7, 0.0, 1.4])
    points = visible(solids, eye)
    corner = points[:, :2] @ [0.8, 0.6]
    points = points[corner < np.percentile(corner, 96)]
    shape = fit(points, table(0.0), eye)
    assert shape is not None
    assert shape.kind == "vessel"
    assert shape.volumes
    bench = fit(visible([Solid("box", np.array([0.31, 0.21, 0.055]), pose((0.0, 0.0, 0.055)))], eye), table(0.0), eye)
    assert bench is not None
    assert bench.kind == "furniture"


def test_a_table_is_furniture_with_a_face() -> None:
    """What is longer than an arm is furniture: a slab under its upper face."""
    top = box((0.5, 0, 0.72), (0.7, 1.2, 0.04))
    shape = fit(visible([top], EYE, 0.01), np.zeros((0, 3)), EYE)
    assert shape is not None
    assert shape.kind == "furniture"
    np.testing.assert_allclose(shape.box()[:, :2], top.aabb()[:, :2], atol=0.02)
    assert shape.box()[1, 2] == pytest.approx(0.74, abs=0.005)


def test_a_book_that_pictures_show_a_little_apart_is_no_vessel() -> None:
    """What seems to lie behind a front, but has a top over it, is no inside: cameras may be mounted a little askew."""
    points = visible([upright("box", (0.0175, 0.075, 0.105), 0.0)], EYE)
    shape = fit(np.concatenate([points, points + [0.014, 0.0, 0.0]]), table(), EYE)
    assert shape is not None
    assert shape.kind == "box"


def racket(yaw: float) -> list[Solid]:
    """A handle, and a hoop of four bars around nothing."""
    T = pose((0.02, 0.03, LEVEL_M + 0.015), yaw)
    parts = [((0.26, 0.034), (-0.14, 0.0)), ((0.022, 0.16), (0.0, 0.0)), ((0.022, 0.16), (0.249, 0.0)),
             ((0.27, 0.022), (0.125, 0.08)), ((0.27, 0.022), (0.125, -0.08))]  # fmt: skip
    return [Solid("box", np.array([a / 2, b / 2, 0.015]), T @ pose((x, y, 0.0))) for (a, b), (x, y) in parts]


@pytest.mark.parametrize("yaw", [0.0, 0.7, 2.0])
def test_a_flat_thing_that_is_narrow_somewhere_can_be_taken_there(yaw: float) -> None:
    """Of a racket no hand spans the hoop, but its handle is told from it; a book has one box."""
    points = visible(racket(yaw), EYE)
    shape = fit(noisy(points, np.random.default_rng(0)), table(), EYE)
    assert shape is not None
    widths = [float(np.sort(solid.half_m[:2])[0] * 2) for solid in shape.solids]
    assert widths[0] > 0.15
    assert any(width < 0.05 for width in widths)
    handle = shape.solids[int(np.argmin(widths))]
    np.testing.assert_allclose(handle.T[:2, 3], racket(yaw)[0].T[:2, 3], atol=0.03)
    book = fit(visible([THINGS["book"]], EYE), table(), EYE)
    assert book is not None
    assert len(book.solids) == 1


def test_nothing_comes_of_too_little() -> None:
    """Fewer than five points are no thing."""
    assert fit(np.zeros((4, 3)), table(), EYE) is None


def test_what_hangs_apart_is_no_part() -> None:
    """Pixels of the background that a mask catches are dropped, wherever they are."""
    own = np.random.default_rng(0).uniform(0, 0.03, (200, 3))
    for away in (0.2, 30.0):
        np.testing.assert_array_equal(main_cluster(np.concatenate([own, own[:20] + away])), own)


def test_parts_of_furniture_that_an_arm_splits_belong_together() -> None:
    """A door that stands open and the inside behind it are one cabinet, what is seen between them or not."""
    rng = np.random.default_rng(0)
    door = rng.uniform(0, 1, (2000, 3)) * [0.02, 0.6, 0.7]
    inside = rng.uniform(0, 1, (1500, 3)) * [0.02, 0.3, 0.7] + [0.4, -0.5, 0.0]
    behind = door[:100] + [2.0, 0.0, 0.0]
    kept = main_cluster(np.concatenate([door, inside, behind]))
    np.testing.assert_array_equal(kept, np.concatenate([door, inside]))


def test_a_foot_below_what_hides_the_rest_belongs_to_the_thing() -> None:
    """From in front and above, a drill shows its body and its foot, and hides the grip between them."""
    rng = np.random.default_rng(0)
    top = rng.uniform(-0.5, 0.5, (300, 3)) * [0.08, 0.14, 0.05] + [0.0, 0.0, 0.15]
    foot = rng.uniform(-0.5, 0.5, (150, 3)) * [0.06, 0.09, 0.03] + [0.0, 0.0, 0.02]
    beside = foot + [0.2, 0.0, 0.0]
    for some in ([top, foot], [foot, top]):
        assert len(main_cluster(np.concatenate([*some, beside]))) == len(top) + len(foot)


def test_a_near_picture_does_not_outvote_a_far_one() -> None:
    """After thinning a patch has as many points however often it was seen."""
    patch = np.random.default_rng(0).uniform(0, 0.04, (3000, 3)) * [1, 1, 0]
    assert len(thinned(np.tile(patch, (5, 1)))) == len(thinned(patch))


def test_a_support_is_what_a_thing_stands_on_not_a_board_below_it() -> None:
    """Of two faces the one level with the thing's foot counts; from below its own foot is all there is."""
    thing = visible([THINGS["can"]], EYE)
    both = np.concatenate([table(), np.tile(table(LEVEL_M - 0.05), (3, 1))])
    assert support_height(thing, both, EYE) == pytest.approx(LEVEL_M, abs=0.002)
    assert support_height(thing, table(LEVEL_M - 0.03), np.array([-1, 0, 0.3])) == pytest.approx(LEVEL_M, abs=0.004)


def test_sides_of_what_lies_beside_a_thing_are_no_support() -> None:
    """Of balls in a heap the lower halves are out of sight; what is level with that are only other balls."""
    balls = [Solid("sphere", np.full(3, 0.03), pose((x, y, LEVEL_M + 0.03))) for x in (0, 0.07) for y in (0, 0.07)]
    points = visible([balls[3]], EYE)
    points = points[points[:, 2] > LEVEL_M + 0.025]
    around = np.concatenate([hidden_behind(table(), balls, EYE), thinned(visible(balls[:3], EYE), 0.01)])
    assert support_height(points, around, EYE) == pytest.approx(LEVEL_M, abs=0.002)


@pytest.mark.parametrize("turn", [0.0, 0.3, 1.5, 2.9])
def test_the_outline_of_a_turned_rectangle_is_that_rectangle(turn: float) -> None:
    """Middle, sides and heading are found at any turn; a disc fills less of its rectangle."""
    rng = np.random.default_rng(1)
    c, s = np.cos(turn), np.sin(turn)
    xy = rng.uniform(-1, 1, (4000, 2)) * [0.1, 0.04] @ np.array([[c, s], [-s, c]]) + [0.5, -0.2]
    found = outline(xy)
    np.testing.assert_allclose(found.middle, [0.5, -0.2], atol=0.002)
    np.testing.assert_allclose(found.sides, [0.2, 0.08], atol=0.003)
    assert abs(np.sin(found.heading - turn)) < 0.03
    assert found.fill > 0.95
    disc = rng.normal(size=(4000, 2))
    assert outline(disc / np.linalg.norm(disc, axis=1, keepdims=True)).fill < 0.82


def test_a_circle_ignores_a_few_strays() -> None:
    """A few strays near it do not move the circle through an arc."""
    angle = np.linspace(0, 2.5, 80)
    xy = np.stack([np.cos(angle), np.sin(angle)], 1) * 0.05
    middle, radius, _ = circle(np.concatenate([xy, [[0.06, 0.01], [0.03, 0.02], [0.0, 0.06]]]))
    np.testing.assert_allclose(middle, 0, atol=0.006)
    assert radius == pytest.approx(0.05, abs=0.006)


def test_walls_are_no_faces_and_a_basin_is_an_opening_in_its_counter() -> None:
    """The face around the opening is solid, and the basin a volume from its bottom to the rim."""
    step = 0.008
    x, y = (g.ravel() for g in np.meshgrid(np.arange(-0.37, 0.37, step), np.arange(-0.31, 0.31, step)))
    hole = (np.abs(x) < 0.24) & (np.abs(y) < 0.18)
    rim, bottom = np.c_[x, y, 0 * x + 0.9][~hole], np.c_[x, y, 0 * x + 0.7][hole]
    u, z = (g.ravel() for g in np.meshgrid(np.arange(-0.24, 0.24, step), np.arange(0.7, 0.9, step)))
    walls = [np.c_[u, 0 * u + 0.18, z], np.c_[0 * u + 0.24, 0.75 * u, z], np.c_[0 * u - 0.24, 0.75 * u, z]]
    shape = fit(np.concatenate([rim, bottom, *walls]), np.zeros((0, 3)), np.array([0.0, -1.0, 1.5]))
    assert shape is not None
    assert shape.kind == "furniture"
    assert Surroundings(shape.solids).distance(np.array([[0.0, 0.0, 0.9]]))[0] > 0.1
    low, high = shape.volumes[0].aabb()
    np.testing.assert_allclose([*low, *high], [-0.24, -0.18, 0.7, 0.24, 0.18, 0.9], atol=0.03)
    assert {round(float(s.aabb()[1, 2]), 2) for s in shape.solids} <= {0.9, 0.7}
