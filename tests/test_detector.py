"""The detector of labels: masks by phrase, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from mpvi_bt.perception.detector import ROBOT, LabelDetector
from mpvi_bt.robot.protocol import CameraImage

VOCABULARY = {"can.n.01_1": ("can of soda", "soda can"), "can.n.01_2": ("can of soda",), "bin": ("trash can",)}
NAMES = {1: "can.n.01_1", 2: "can.n.01_2", 3: "bin", 4: "robot", 5: "robot"}


def picture(labels: list[list[int]] | None) -> CameraImage:
    shape = np.shape(labels) if labels is not None else (2, 2)
    array = None if labels is None else np.array(labels, np.int32)
    depth = np.ones(shape, np.float32)
    return CameraImage("head", np.zeros((*shape, 3), np.uint8), depth, array, NAMES, np.eye(3), np.eye(4))


LABELS = [[0, 1, 1, 4], [2, 0, 3, 5]]


@pytest.mark.parametrize("phrase", ["can of soda", "a can of soda", "Can  of soda"])
def test_a_phrase_finds_every_thing_that_is_called_so(phrase: str) -> None:
    """Each thing has its own mask and box; the phrase comes back as it was asked."""
    found = LabelDetector(VOCABULARY).detect(picture(LABELS), [phrase])
    assert [d.phrase for d in found] == [phrase, phrase]
    np.testing.assert_array_equal(found[0].mask, np.array(LABELS) == 1)
    np.testing.assert_array_equal(found[0].box, [1, 0, 3, 1])
    np.testing.assert_array_equal(found[1].box, [0, 1, 1, 2])


def test_a_detection_does_not_tell_which_thing_it_is() -> None:
    """No name of a label goes through: what the next picture shows is told by place alone."""
    for detection in LabelDetector(VOCABULARY).detect(picture(LABELS), ["can of soda", "trash can", ROBOT]):
        said = (detection.phrase, detection.score)
        assert not any(name in str(said) for name in VOCABULARY)


def test_the_robot_is_one_thing() -> None:
    """All of the robot's parts are one mask."""
    (found,) = LabelDetector(VOCABULARY).detect(picture(LABELS), [ROBOT])
    np.testing.assert_array_equal(found.mask, np.array(LABELS) >= 4)


@pytest.mark.parametrize("labels", [None, [[0, 0], [0, 0]]])
def test_where_there_is_nothing_nothing_is_found(labels: list[list[int]] | None) -> None:
    """Without labels, or with none that is asked for, there are no detections."""
    assert LabelDetector(VOCABULARY).detect(picture(labels), ["can of soda", ROBOT]) == []


def test_what_is_not_in_the_vocabulary_is_not_found() -> None:
    """A phrase that nobody uses finds nothing, even where it is the label itself."""
    assert LabelDetector(VOCABULARY).detect(picture(LABELS), ["can.n.01_1", "elephant"]) == []
