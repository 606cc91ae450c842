"""Furniture that stands open, by the points of its faces."""

from __future__ import annotations

import numpy as np
import pytest

from mpvi_bt.finding.shapes.fit import fit
from mpvi_bt.finding.shapes.furniture_shape import furniture
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array

DEPTH, WIDTH, TOP, BOARD = 0.56, 0.58, 0.86, 0.48
THICK_M, GRAIN_M = 0.02, 0.008


def sheet(origin: Array, along: Array, up: Array) -> Array:
    """Points (n, 3) of a rectangle with a corner at `origin` and two sides (3,)."""
    u, v = (np.arange(0.0, 1.0, GRAIN_M / float(np.linalg.norm(side))) for side in (along, up))
    return np.asarray(origin + u[:, None, None] * along + v[None, :, None] * up).reshape(-1, 3)


def open_cabinet(door_rad: float) -> Array:
    """Points (n, 3) of one with a board and a door, its front at x = 0 toward -x; the door hangs at y = 0."""
    x, y, z = DEPTH * np.eye(3)[0], WIDTH * np.eye(3)[1], np.eye(3)[2]
    out = np.array([-np.sin(door_rad), np.cos(door_rad), 0.0])
    door, thick = WIDTH * out, THICK_M * np.array([out[1], -out[0], 0.0])
    origin = np.zeros(3)
    parts = [sheet(height * z, x, y) for height in (0.12, BOARD, TOP)]
    parts += [sheet(0.12 * z, x, 0.74 * z), sheet(y + 0.12 * z, x, 0.74 * z), sheet(x + 0.12 * z, y, 0.74 * z)]
    parts += [sheet(origin + 0.12 * z, door, 0.74 * z), sheet(TOP * z, door, thick), sheet(BOARD * z, door, thick)]
    return np.concatenate(parts)


@pytest.mark.parametrize("door_rad", [0.9, 1.3, 1.8, 2.2])
def test_the_edge_of_an_open_door_is_no_part_of_a_compartment(door_rad: float) -> None:
    """However far the door stands open, both compartments are found, and lie as the cabinet does, within 4 cm."""
    shape = furniture(open_cabinet(door_rad))
    boxes = sorted((volume.aabb() for volume in shape.volumes), key=lambda box: float(box[0, 2]))
    assert len(boxes) == 2
    for box, floor, roof in zip(boxes, (0.12, BOARD), (BOARD, TOP), strict=True):
        np.testing.assert_allclose(box[:, :2], [[0.0, 0.0], [DEPTH, WIDTH]], atol=0.04)
        np.testing.assert_allclose(box[:, 2], [floor, roof], atol=0.04)


def test_what_is_not_over_a_board_does_not_close_what_is_above_it() -> None:
    """A ledge before the front may be as high as a top that is not in view; it is no top."""
    points = open_cabinet(1.3)
    ledge = sheet(np.array([-0.3, 0.0, TOP]), np.array([0.3, 0.0, 0.0]), np.array([0.0, WIDTH, 0.0]))
    points = np.concatenate([points[(points[:, 0] < 0.0) | (points[:, 2] < TOP - 0.01)], ledge])
    high = max(furniture(points).volumes, key=lambda volume: float(volume.T[2, 3])).aabb()
    np.testing.assert_allclose(high[:, :2], [[0.0, 0.0], [DEPTH, WIDTH]], atol=0.04)
    np.testing.assert_allclose(high[:, 2], [BOARD, TOP], atol=0.04)


@pytest.mark.parametrize("sides", [3, 4])
def test_a_narrow_rim_is_a_face_all_the_same(sides: int) -> None:
    """Of a drawer that stands open little more is level than its edges, and not all of them may be in view."""
    x, y, z = np.diag([0.44, 0.8, TOP])
    a, b = x * THICK_M / 0.44, y * THICK_M / 0.8
    rim = [sheet(z, x, b), sheet(z + y, x, b), sheet(z, a, y), sheet(z + x, a, y)][:sides]
    bottom = sheet(z - [0.0, 0.0, 0.2], x, y)
    boards = furniture(np.concatenate([*rim, bottom])).solids
    assert any(abs(board.aabb()[1, 2] - TOP) < 0.01 for board in boards)


def test_what_lies_here_and_there_at_one_height_is_no_board() -> None:
    """Where walls cease to be in view a few points seem level: a board there would close the room between two."""
    z, height = np.eye(3)[2], 0.66
    corners = [(0.1, 0.1), (0.1, 0.4), (0.4, 0.1), (0.4, 0.4)]
    patches = [sheet(np.array([*at, height]), 0.03 * np.eye(3)[0], 0.03 * np.eye(3)[1]) for at in corners]
    shape = furniture(np.concatenate([open_cabinet(1.3), *patches]))
    assert not any(abs(board.aabb()[1, 2] - height) < 0.05 for board in shape.solids)
    assert len(shape.volumes) == 2
    shelf = sheet(height * z, DEPTH * np.eye(3)[0], WIDTH * np.eye(3)[1])
    assert len(furniture(np.concatenate([open_cabinet(1.3), shelf])).volumes) == 3


@pytest.mark.parametrize("heading", [0.0, 0.4, 0.8, 1.2])
@pytest.mark.parametrize("tall", [0.01, 0.02])
def test_a_board_on_the_floor_reaches_no_deeper_than_the_floor(heading: float, tall: float) -> None:
    """Fingers that are to press its sides would have to go into the floor, else; however it is turned."""
    along, across = kin.rot_z(heading)[:, :2].T
    board = sheet(np.array([1.0, 0.0, tall]), 0.6 * along, 0.4 * across)
    ground = sheet(np.array([0.0, -1.0, 0.0]), np.array([2.4, 0.0, 0.0]), np.array([0.0, 2.4, 0.0]))
    at = (ground - board[0])[:, :2] @ np.stack([along, across])[:, :2].T
    ground = ground[((at < -0.01) | (at > [0.61, 0.41])).any(1)]
    shape = fit(board, ground, np.array([0.0, 0.0, 1.4]))
    assert shape is not None
    assert -0.002 < shape.box()[0, 2] <= tall
    assert shape.box()[1, 2] == pytest.approx(tall, abs=0.002)
