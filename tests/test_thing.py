"""When two things of one name are one."""

from __future__ import annotations

import numpy as np
import pytest

from mpvi_bt.finding.scene.associator import is_again
from mpvi_bt.finding.scene.thing_store import SeenThing
from mpvi_bt.finding.shapes.shape import Shape
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Solid


def box(name: str, middle: tuple[float, float, float], size: tuple[float, float, float]) -> SeenThing:
    """A thing of that size [m] about that place; it is called as its name is, but for the number."""
    solid = Solid("box", np.array(size) / 2, kin.transform(np.eye(3), middle))
    return SeenThing(name, name.rpartition(" ")[0], Shape("box", solid.T, (solid,), support_m=middle[2] - size[2] / 2))


@pytest.mark.parametrize(
    ("other", "again"),
    [
        (box("bowl 2", (0.005, 0.0, 0.04), (0.17, 0.2, 0.08)), True),  # of the same one less was seen first
        (box("bowl 2", (0.0, 0.0, 0.065), (0.2, 0.2, 0.08)), False),  # it stands in the other
        (box("bowl 2", (0.19, 0.0, 0.04), (0.2, 0.2, 0.08)), False),  # it stands beside it
        (box("plate 2", (0.0, 0.0, 0.04), (0.2, 0.2, 0.08)), False),  # it is another kind of thing
    ],
)
def test_what_fills_the_same_space_is_the_same(other: SeenThing, again: bool) -> None:
    """Whichever of the two was known first."""
    one = box("bowl 1", (0.0, 0.0, 0.04), (0.2, 0.2, 0.08))
    assert is_again(other, one) is again
    assert is_again(one, other) is again
