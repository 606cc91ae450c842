"""Searches made up for the tests of their pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.executive.plan.knowledge import Entry
from mpvi_bt.finding.perception.detector import Detection
from mpvi_bt.finding.scene.occupancy_map import OccupancyMap
from mpvi_bt.ground.geometry.solids import Array
from mpvi_bt.ground.robot.protocol import CameraImage
from tests.navigation_maps import thing, two_rooms

Mask = NDArray[np.bool_]


def look(x: float, y: float, yaw: float, shade: int = 90) -> CameraImage:
    """An even picture of a head camera 1.2 m above a place, level, 90 degrees wide."""
    c, s = np.cos(yaw), np.sin(yaw)
    T = np.array([[s, 0, c, x], [-c, 0, s, y], [0, -1, 0, 1.2], [0, 0, 0, 1]], float)
    K = np.array([[160, 0, 160], [0, 160, 120], [0, 0, 1]], float)
    rgb = np.full((240, 320, 3), shade, np.uint8)
    return CameraImage("head", rgb, np.full((240, 320), 2.0, np.float32), None, {}, K, T)


def box(phrase: str, left: int, top: int, right: int, bottom: int, score: float = 0.9) -> Detection:
    """A detection without a mask."""
    return Detection(phrase, score, np.array([left, top, right, bottom]))


def find(name: str, x: float, y: float, **more: object) -> Entry:
    """A small thing that was seen."""
    return thing(name, (x, y, 0.06), (0.08, 0.08, 0.12), **{"source": "segmentation", "seen_s": 1.0, **more})


@dataclass
class MadeUpSearch:
    """A search in two rooms; the kitchen's western half was seen."""

    map: OccupancyMap = field(default_factory=two_rooms)
    known: Mask = field(default_factory=lambda: np.ones((80, 160), bool))
    seen: Mask = field(default_factory=lambda: np.arange(160)[None, :] < np.full((80, 1), 40))
    frontier: Mask = field(default_factory=lambda: np.zeros((80, 160), bool))
    path: Array | None = None
    goal: Array | None = None
    image: CameraImage | None = None
    detections: Sequence[Detection] = ()
    entries: Sequence[Entry] = ()


def searching() -> MadeUpSearch:
    """A search with one of everything."""
    search = MadeUpSearch(image=look(1, 2, 0), detections=[box("can", 100, 110, 140, 150)], entries=[find("can", 3, 3)])
    search.path, search.goal = np.array([[1.0, 2.0], [3.0, 2.0]]), np.array([3.0, 2.0, 0.0])
    search.frontier[20:60, 39] = True
    return search
