"""What is remembered of what stands around, while no picture shows it."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
from numpy.typing import NDArray

from mpvi_bt.finding.scene.field import Field, View
from mpvi_bt.finding.scene.remembered import Remembered
from mpvi_bt.ground.geometry import kinematics as kin
from mpvi_bt.ground.geometry.solids import Array, pose
from mpvi_bt.ground.robot.protocol import CameraImage

SIZE = (120, 160)
K = np.array([[130.0, 0, 80], [0, 130.0, 60], [0, 0, 1]])
# A camera 1 m up at the origin that looks along +x, over 1.4 m of the height of what is 1.5 m off.
FORWARD = kin.transform(kin.LINK_TO_OPTICAL, (0.0, 0.0, 1.0))
BACK = pose((0.0, 0.0, 0.0), np.pi) @ FORWARD
ALL = np.ones(SIZE, bool)
AT = (1.5, 0.2)


def picture(depth: Array | float, T: Array = FORWARD) -> CameraImage:
    whole = np.full(SIZE, depth, np.float32)
    return CameraImage("head", np.zeros((*SIZE, 3), np.uint8), whole, None, {}, K, T)


def seen(*pictures: CameraImage, fixed: NDArray[np.bool_] = ALL) -> Remembered:
    known = Remembered()
    for image in (*pictures, *pictures):
        known.see(image, fixed)
    return known


def stays(known: Remembered, x: float, y: float, z: float = 0.8) -> bool:
    """Whether something does, out of view, within half a hand's breadth of a place."""
    off = np.linspace(-0.05, 0.05, 9)
    return bool(known.around(x + off, y + off, np.array([z]))[0].any())


def test_a_wall_stands_where_it_was_seen_and_nowhere_else() -> None:
    """Also once the camera looks away; before it, behind it and beside what was in view there is none."""
    known = seen(picture(1.5), picture(2.4, BACK))
    assert stays(known, *AT)
    assert stays(known, *AT, 1.6)
    assert not stays(known, *AT, 1.8)
    assert not any(stays(known, *p) for p in ((0.8, 0.2), (1.3, 0.2), (2.0, 0.2), (1.5, 1.5)))


def test_what_is_seen_through_has_gone() -> None:
    """However often it was seen before, such as a door that stood open."""
    known = seen(*[picture(1.5)] * 20)
    for _ in range(6):
        known.see(picture(2.4), ALL)
    assert not stays(known, *AT)
    assert stays(known, 2.4, 0.2)


def test_one_picture_alone_is_not_believed_of_small_things() -> None:
    """A pixel that is off by more than noise would bar the way for good; a wall is more than a pixel."""
    rows = np.arange(SIZE[0])[:, None]
    both = picture(np.where(abs(rows - 75) < 10, 1.5, 2.4) * np.ones(SIZE))
    known, at = Remembered(), [np.array([v]) for v in (*AT, 0.83)]
    known.see(both, ALL)
    assert not known.around(*at)[1].any()
    known.see(both, ALL)
    assert known.around(*at)[1].all()


def test_low_things_and_what_is_told_to_be_none_are_no_walls() -> None:
    """A table's side or a chair is soon elsewhere, and the robot's own arm is always."""
    rows = np.arange(SIZE[0])[:, None]
    low = np.where(rows > 60, 1.5, 2.4) * np.ones(SIZE)  # up to the camera's height, 1 m, from 0.31 m up
    assert not stays(seen(picture(low)), *AT)
    assert not stays(seen(picture(1.5), fixed=~ALL), *AT)


def test_what_hangs_overhead_stays_and_what_lies_on_a_table_does_not() -> None:
    """A lid that stands open is met by the head; a bag may have been put elsewhere since."""
    rows = np.arange(SIZE[0])[:, None]
    both = np.where((rows < 20) | (abs(rows - 75) < 10), 1.5, 2.4) * np.ones(SIZE)
    known = seen(picture(both))
    assert stays(known, *AT, 1.55)
    assert not stays(known, *AT, 0.83)
    assert known.around(np.array([AT[0]]), np.array([AT[1]]), np.array([0.83]))[1].all()


def test_walls_go_along_and_what_is_far_off_is_forgotten() -> None:
    """Three meters farther they stand where they stood; twenty meters off nothing is known, nor after that."""
    known = seen(picture(1.5), picture(1.0, pose((-3.5, 0.0, 0.0), np.pi) @ FORWARD))
    assert stays(known, *AT)
    known.see(picture(1.0, pose((-20.0, 0.0, 0.0), np.pi) @ FORWARD), ALL)
    assert not stays(known, *AT)
    known.see(picture(1.0, BACK), ALL)
    assert not stays(known, *AT)


def test_a_new_grid_knows_of_none() -> None:
    """Before any picture there is no wall anywhere."""
    assert not np.any(Remembered().around(np.zeros(3), np.zeros(4), np.zeros(5)))


def test_in_a_field_walls_count_where_nothing_is_in_view() -> None:
    """What a picture shows to be free is free, wherever a wall was known to be."""
    known, middle = seen(picture(1.5)), np.array([0.75, 0.0])
    away = Field([View(picture(2.4, BACK), ~ALL)], middle, known=known.around)
    assert away.distance(np.array([1.5, 0.2, 1.0])) < 0.05
    assert away.distance(np.array([1.5, 0.2, 1.9])) > 0.1
    through = Field([View(picture(2.4), ~ALL)], middle, known=known.around)
    assert through.distance(np.array([1.5, 0.2, 1.0])) > 0.1


def test_in_a_field_what_was_seen_counts_behind_the_robot_itself() -> None:
    """Not behind another thing that is no obstacle, nor where a picture shows it to be free by now."""
    rows = np.arange(SIZE[0])[:, None]
    edge = seen(picture(np.where((rows > 55) & (rows < 65), 1.0, 2.4) * np.ones(SIZE)))
    arm = (rows > 40) & (rows < 80) & ALL
    now, middle, at = picture(np.where(arm, 0.4, 2.4)), np.array([0.75, 0.0]), np.array([1.0, 0.1, 1.0])

    def gap(*views: View) -> float:
        return float(Field(views, middle, known=edge.around).distance(at))

    assert gap(View(now, arm, arm)) < 0.05
    assert gap(View(now, arm)) > 0.1
    assert gap(View(now, arm, arm), View(picture(2.4), ~ALL)) > 0.1
    assert Field([View(now, arm, arm)], middle).distance(at) > 0.1


DROPPED = """
import re
import numpy as np
from tests.test_remembered import picture, seen

def resident_mb():
    return int(re.search(r"VmRSS:\\s+(\\d+)", open("/proc/self/status").read())[1]) / 1000

seen(picture(1.5))  # what is compiled, and what malloc learns of sizes
before = resident_mb()
memories, kept = [], []
for _ in range(20):
    memories.append(seen(picture(1.5)))
    kept.append(np.ones(50_000))  # stands behind it, where both are of the heap
most = resident_mb()
memories.clear()
print(most - before, resident_mb() - before)
"""


def test_a_memory_that_is_dropped_leaves_no_hole() -> None:
    """What policies remember goes back to the system with them, whatever was allocated since."""
    done = subprocess.run([sys.executable, "-c", DROPPED], capture_output=True, text=True, check=True, timeout=120)
    most, left = map(float, done.stdout.split())
    assert most > 10  # [MB]
    assert left < 12  # of which 8 are kept
