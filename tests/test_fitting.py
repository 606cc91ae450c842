"""What views of one thing agree on, whichever cameras took them, and wherever from."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.finding.scene.frames import Frame
from mpvi_bt.finding.scene.several_views import View, fitted
from mpvi_bt.ground.robot.protocol import CameraImage

_PX = 40


def view(camera: str, stand: int, hidden: bool) -> View:
    """A can of 8 x 8 x 12 cm on the floor from above; `hidden`: its mask turned out to be the robot's own."""
    x, y = np.meshgrid(np.linspace(-0.2, 0.2, _PX), np.linspace(-0.2, 0.2, _PX))
    mask = (np.abs(x) < 0.04) & (np.abs(y) < 0.04)
    points = np.stack([x, y, np.where(mask, 0.12, 0.0)], axis=-1)
    T = np.eye(4)
    T[2, 3] = 1.0
    depth = np.asarray(1.0 - points[..., 2], np.float32)
    image = CameraImage(
        camera=camera, rgb=np.zeros((_PX, _PX, 3), np.uint8), depth=depth, labels=None, names={},
        K=np.eye(3), T_world_camera=T,
    )  # fmt: skip
    return Frame(image, points, mask if hidden else np.zeros_like(mask), (), stand, 0.0), mask


@given(st.lists(st.tuples(st.sampled_from(["head", "left", "right"]), st.integers(0, 2), st.booleans()), min_size=1))
def test_any_views_have_a_shape_if_any_shows_the_thing(taken: list[tuple[str, int, bool]]) -> None:
    """Of a sandal that a wrist had seen before a drive, all newer masks were found to be in hand: it crashed."""
    shape = fitted([view(*one) for one in sorted(taken, key=lambda one: one[1])], 0.0)
    if all(hidden for _, _, hidden in taken):
        assert shape is None
    else:
        assert shape is not None
        assert shape.box()[:, :2] == pytest.approx(np.array([[-0.04, -0.04], [0.04, 0.04]]), abs=0.012)
