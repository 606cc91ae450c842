"""Pictures that eyes are trained and tested on, and the counting of what they see."""

from __future__ import annotations

import colorsys
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.eyes.pictures import pictures_of
from benchmarks.eyes.scenes import HELD_OUT
from benchmarks.eyes.seen import look_at_all
from benchmarks.eyes.variants import ONE_COLOR, drawn
from mpvi_bt.finding.eyes.picture_file import LabeledPicture
from mpvi_bt.finding.perception.segments import Segments
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.house.things.catalogue import load_catalogue


def hue(color: str) -> float:
    """Of a color "#rrggbb", 0 to 1."""
    return colorsys.rgb_to_hsv(*(int(color[k : k + 2], 16) / 255 for k in (1, 3, 5)))[0]


def test_held_out_colors_are_never_trained_on() -> None:
    """Of ten kinds training has about their own color only; the held-out ones are far from it."""
    can, rng = load_catalogue()["can_of_soda"], np.random.default_rng(0)
    assert can.synset in ONE_COLOR
    own = hue(can.shape["color"])
    for how, near in (("trained", True), ("held_out_color", False)):
        for _ in range(50):
            entry, _ = drawn(can, rng, how)  # type: ignore[arg-type]
            off = abs((hue(entry.shape["color"]) - own + 0.5) % 1 - 0.5)
            assert (off < 0.06) is near


def test_held_out_shapes_are_never_trained_on() -> None:
    """Held-out shapes are drawn out more in height than any that training has."""
    can, rng = load_catalogue()["can_of_soda"], np.random.default_rng(0)
    slim = can.shape["height_m"] / can.shape["diameter_m"]
    for _ in range(50):
        trained, held_out = (drawn(can, rng, how)[0].shape for how in ("trained", "held_out_shape"))
        assert trained["height_m"] / trained["diameter_m"] <= slim * 1.15 + 1e-9
        assert held_out["height_m"] / held_out["diameter_m"] >= slim * 1.15 - 1e-9


def test_every_movable_thing_can_be_drawn() -> None:
    """Each entry of the catalogue has valid shapes in all sizes and colors."""
    rng = np.random.default_rng(0)
    for entry in load_catalogue():
        if entry.mass_kg is not None:
            assert drawn(entry, rng, "held_out_shape")[1] == "held_out_shape", entry.name


def test_ten_houses_are_held_out() -> None:
    """No held-out house has a seed that training draws."""
    assert len(set(HELD_OUT)) == 10
    assert all(int(name.rpartition(":")[2]) > 1000 for name in HELD_OUT)


class Perfect:
    """Segments as the labels of the last picture have them."""

    kinds = ("can.n.01", "chair")

    def __init__(self, picture: LabeledPicture) -> None:
        self.picture = picture

    def segment(self, image: CameraImage) -> Segments:
        """All of it."""
        return Segments(self.picture.labels.astype(np.int32), self.picture.kinds, np.ones(len(self.picture.kinds)))


def test_what_is_seen_is_counted() -> None:
    """Perfect eyes find all, and segments of a wrong kind are outlined but not found."""
    labels = np.zeros((40, 40), np.uint8)
    labels[:10, :10], labels[20:, 20:] = 1, 2
    picture = LabeledPicture(
        np.zeros((40, 40, 3), np.uint8), np.ones((40, 40), np.float32), labels, ("can.n.01", "chair"),
        ("catalogue", "fixture"), np.eye(3), np.eye(4), "head",
    )  # fmt: skip
    seen = look_at_all(Perfect(picture), [picture])
    assert seen.mean_overlap == 1
    assert all(thing.found for thing in seen.things)
    assert all(segment.right for segment in seen.segments)
    wrong = Perfect(picture)
    wrong.picture = replace(picture, kinds=("cup.n.01", "chair"))
    seen = look_at_all(wrong, [picture])
    assert [(thing.outlined, thing.found) for thing in seen.things] == [(True, False), (True, True)]
    assert [segment.right for segment in seen.segments] == [False, True]


@pytest.mark.slow
@pytest.mark.render
def test_the_same_seed_makes_the_same_pictures() -> None:
    """Pictures of a seed are the same each time, hold what they are labeled with, and are no two alike."""
    first, again = (pictures_of(3, "train", 4) for _ in range(2))
    assert len(first) == 4
    for a, b in zip(first, again, strict=True):
        assert (a.rgb == b.rgb).all()
        assert (a.labels == b.labels).all()
        assert a.kinds == b.kinds
        assert a.labels.max() <= len(a.kinds) == len(a.drawn)
