"""What a network takes a picture to show: segments, each with a kind and a score, and no simulator behind them."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.finding.perception.detector import ROBOT, SWITCH
from mpvi_bt.ground.robot.protocol import CameraImage

SWITCHES = "switch"  # the kind of all switches, whatever they belong to
FLOOR = "floor"
# Kinds of furniture, by the words that the labels of fixtures end in. What ends otherwise is background: walls,
# windows, pictures, rugs, mirrors, lawns. Our choice: what no skill asks for.
FURNITURE = (
    "bathtub", "bed", "bookcase", "cabinet", "car", "chair", "chest_of_drawers", "coffee_table", "countertop", "desk",
    "dishwasher", "door", "electric_refrigerator", "gate", "hallstand", "hood", "lamp", "microwave", "nightstand",
    "oven", "plant", "shelf", "sink", "sofa", "stove", "swivel_chair", "table", "tabletop", "toilet", "tree",
    "wall_nail", "washer", "wood_fireplace",
)  # fmt: skip
_ALIKE = {"utility_counter": "countertop"}
_SYNSET = re.compile(r"(.+\.n\.\d+)(_\d+)?")
_NUMBER = re.compile(r"_\d+$")


@dataclass(frozen=True, eq=False)
class Segments:
    """A picture cut into segments.

    Attributes:
        labels: (H, W) int32, 0 where nothing is seen that the network knows, else k for segment k, counted from 1.
        kinds: Kind of each of the N segments, as `kind_of` names them; the robot's own parts are `ROBOT`.
        scores: (N,) how sure each kind is, 0 to 1, calibrated.
    """

    labels: NDArray[np.int32]
    kinds: tuple[str, ...]
    scores: NDArray[np.float64]

    def expecting(self, kinds: Collection[str], outlines: NDArray[np.int32] | None = None) -> Segments:
        """The same picture, seen by who knows more; who has no doubts, as here, sees the same.

        Args:
            kinds: Asked for, and so likelier to be there.
            outlines: (H, W) numbers from 1 of pixels that may each be one thing's, such as what is between the fingers;
                0 elsewhere.
        """
        return self


class Segmenter(Protocol):
    """Cuts pictures into segments.

    Attributes:
        kinds: All that it knows, without background.
    """

    kinds: tuple[str, ...]

    def segment(self, image: CameraImage) -> Segments:
        """What the picture shows, by its colors, its depth, `K` and `T_world_camera` alone, never its labels."""
        ...


def kind_of(label: str) -> str:
    """What kind of thing has a label of the simulator; "" for background.

    A movable thing's is its synset: "can__of__soda.n.01" of "can__of__soda.n.01_1". A fixture's is one of `FURNITURE`:
    "chair" of "dining_chair_2". All switches are of one kind, and so are all floors.
    """
    if label == ROBOT:
        return ROBOT
    if label.endswith(SWITCH):
        return SWITCHES
    if (synset := _SYNSET.fullmatch(label)) is not None:
        return synset[1]
    words = _NUMBER.sub("", label)
    if words in _ALIKE:
        return _ALIKE[words]
    ends = [kind for kind in FURNITURE if words == kind or words.endswith("_" + kind)]
    return max(ends, key=len, default=FLOOR if words.split("_")[0] == FLOOR else "")
