"""The segmentation detector: masks by phrase and nothing else, and its mistakes."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mpvi_bt.finding.perception.detector import ROBOT, GuardedDetector
from mpvi_bt.finding.perception.segmentation import LOWEST_SCORE, NO_ERRORS, DetectionErrors, SegmentationDetector
from mpvi_bt.ground.errors import UnknownName, UserError
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.testing import check_detector

VOCABULARY = {"can.n.01_1": ("can of soda", "soda can"), "can.n.01_2": ("can of soda",), "bin": ("trash can",)}
NAMES = {1: "can.n.01_1", 2: "can.n.01_2", 3: "bin", 4: "robot", 5: "robot"}
LABELS = [[0, 1, 1, 4], [2, 0, 3, 5]]

# Twelve things in a row, each of 16 x 16 px, four kinds of them asked for.
MANY_NAMES = {k + 1: f"thing_{k}" for k in range(12)}
MANY = {f"thing_{k}": (("cup", "bowl", "plate", "fork", "tray", "vase")[k % 6],) for k in range(12)}
ASKED = ["cup", "bowl", "plate", "fork"]


def picture(labels: object, names: dict[int, str] = NAMES) -> CameraImage:
    array = None if labels is None else np.array(labels, np.int32)
    shape = (2, 2) if array is None else array.shape
    depth = np.ones(shape, np.float32)
    return CameraImage("head", np.zeros((*shape, 3), np.uint8), depth, array, names, np.eye(3), np.eye(4))


def many() -> CameraImage:
    labels = np.zeros((20, 12 * 20), np.int32)
    for k in range(12):
        labels[2:18, 20 * k + 2 : 20 * k + 18] = k + 1
    return picture(labels, MANY_NAMES)


def ideal() -> SegmentationDetector:
    return SegmentationDetector(VOCABULARY, least_px=1)


@pytest.mark.parametrize(
    "phrase", ["can of soda", "a can of soda", "Can  of soda", "two red cans of soda on the table"]
)
def test_a_phrase_finds_every_thing_that_is_called_so(phrase: str) -> None:
    """Each thing has its own mask and box; the phrase comes back as it was asked."""
    found = ideal().detect(picture(LABELS), [phrase])
    assert [d.phrase for d in found] == [phrase, phrase]
    np.testing.assert_array_equal(found[0].mask, np.array(LABELS) == 1)
    np.testing.assert_array_equal(found[0].box, [1, 0, 3, 1])
    np.testing.assert_array_equal(found[1].box, [0, 1, 1, 2])


def test_a_detection_does_not_tell_which_thing_it_is() -> None:
    """No name of a label goes through: what the next picture shows is told by place alone."""
    for detection in ideal().detect(picture(LABELS), ["can of soda", "trash can", ROBOT]):
        said = (detection.phrase, detection.score)
        assert not any(name in str(said) for name in VOCABULARY)


def test_the_robot_is_one_thing() -> None:
    """All of the robot's parts are one mask, however small."""
    for detector in (ideal(), SegmentationDetector(VOCABULARY, least_px=1000)):
        (found,) = detector.detect(picture(LABELS), [ROBOT])
        np.testing.assert_array_equal(found.mask, np.array(LABELS) >= 4)


@pytest.mark.parametrize("labels", [None, [[0, 0], [0, 0]], np.zeros((0, 0))])
def test_where_there_is_nothing_nothing_is_found(labels: object) -> None:
    """Without labels, or with none that is asked for, there are no detections."""
    assert ideal().detect(picture(labels), ["can of soda", ROBOT]) == []


def test_what_is_not_in_the_vocabulary_is_not_found() -> None:
    """A phrase that nobody uses finds nothing, even where it is the label itself; nor does an empty one."""
    assert ideal().detect(picture(LABELS), ["can.n.01_1", "elephant", "", "the"]) == []


def test_a_thing_of_fewer_pixels_than_the_least_is_not_seen() -> None:
    """The least size counts visible pixels, not those of the box."""
    ring = np.ones((5, 5), int)
    ring[1:4, 1:4] = 0
    assert SegmentationDetector(VOCABULARY, least_px=17).detect(picture(ring), ["can of soda"]) == []
    (found,) = SegmentationDetector(VOCABULARY, least_px=16).detect(picture(ring), ["can of soda"])
    np.testing.assert_array_equal(found.mask, ring == 1)


@given(st.lists(st.integers(-(2**31), 2**31 - 1), min_size=2, max_size=6, unique=True))
def test_label_ids_may_be_any_numbers(ids: list[int]) -> None:
    """What a pixel shows depends on the name of its id alone; an id without a name shows nothing."""
    names = dict.fromkeys(ids[1:], "bin")
    labels = np.array([ids, ids])
    found = ideal().detect(picture(labels, names), ["trash can"])
    assert len(found) == 1
    np.testing.assert_array_equal(found[0].mask, np.isin(labels, ids[1:]))


@pytest.mark.parametrize("errors", [NO_ERRORS, DetectionErrors(0.2, 0.2, 3.0)], ids=["ideal", "with_errors"])
def test_it_keeps_the_contract_of_detectors(errors: DetectionErrors) -> None:
    """As every detector does, with its mistakes and without."""
    check_detector(
        lambda: SegmentationDetector(MANY, errors=errors, seed=3), pictures=[many(), picture(LABELS)], phrases=ASKED
    )


def test_by_default_nothing_is_wrong() -> None:
    """The errors are off unless they are asked for, and then there is nothing to tell."""
    detector = SegmentationDetector(MANY)
    assert (detector.name, detector.note) == ("segmentation", "")
    for _ in range(3):
        found = detector.detect(many(), ASKED)
        assert [d.phrase for d in found] == [phrase for phrase in ASKED for _ in range(2)]


def test_errors_are_told_in_one_line() -> None:
    """What is printed names each of them and the seed; the name is the address that makes the same ones."""
    detector = SegmentationDetector(MANY, errors=DetectionErrors(0.1, 0.05, 2.0), seed=7)
    assert detector.note == (
        "detector segmentation errs on purpose: misses 10.0%, confuses 5.0%, edges off by 2 px, seed 7"
    )
    assert detector.name == "segmentation:miss=0.1,confuse=0.05,jitter=2"
    assert (GuardedDetector(detector).name, GuardedDetector(detector).note) == (detector.name, detector.note)
    assert DetectionErrors.read(detector.name.partition(":")[2], "x") == DetectionErrors(0.1, 0.05, 2.0)


def test_each_thing_is_missed_as_often_as_it_should_be() -> None:
    """A rate is a rate: of 4000 things a tenth are missed, within four standard deviations."""
    detector = SegmentationDetector(MANY, errors=DetectionErrors(miss=0.1), seed=1)
    found = sum(len(detector.detect(many(), ASKED)) for _ in range(500))
    assert abs(found / 4000 - 0.9) < 4 * np.sqrt(0.1 * 0.9 / 4000)


def test_each_phrase_is_confused_as_often_as_it_should_be() -> None:
    """In a tenth of the pictures a phrase is seen in what it does not name, besides what it names."""
    detector = SegmentationDetector(MANY, errors=DetectionErrors(confuse=0.1), seed=1)
    right = wrong = 0
    for _ in range(1000):
        for d in detector.detect(many(), ASKED):
            mistaken = MANY[f"thing_{(d.box[0] - 2) // 20}"] != (d.phrase,)
            right, wrong = right + (not mistaken), wrong + mistaken
    assert right == 8000
    assert abs(wrong / 4000 - 0.1) < 4 * np.sqrt(0.1 * 0.9 / 4000)


def test_scores_tell_a_little_of_what_is_confused() -> None:
    """Right ones are at two thirds of the way from the lowest score to 1 on average, wrong ones at one third."""
    detector = SegmentationDetector(MANY, errors=DetectionErrors(confuse=0.3), seed=1)
    scores: dict[bool, list[float]] = {True: [], False: []}
    for _ in range(300):
        for d in detector.detect(many(), ASKED):
            scores[MANY[f"thing_{(d.box[0] - 2) // 20}"] == (d.phrase,)].append(d.score)
    for right, mean in ((True, 2 / 3), (False, 1 / 3)):
        share = (np.array(scores[right]) - LOWEST_SCORE) / (1 - LOWEST_SCORE)
        assert ((share >= 0) & (share <= 1)).all()
        assert abs(share.mean() - mean) < 4 * np.sqrt(1 / 18 / len(share))
    only_missing = SegmentationDetector(MANY, errors=DetectionErrors(miss=0.3, jitter=1.0))
    assert {d.score for d in only_missing.detect(many(), ASKED)} == {1.0}


def test_anything_else_in_view_may_be_taken_for_what_is_asked() -> None:
    """Asked for or not; where there is nothing else there is nothing to confuse."""
    errors = DetectionErrors(confuse=1.0)
    detector = SegmentationDetector(MANY, errors=errors)
    places = [(d.box[0] - 2) // 20 for _ in range(200) for d in detector.detect(many(), ["cup"])]
    assert set(places) == set(range(12))
    assert len(places) == 600  # two cups and one other thing
    alone = picture(np.ones((5, 5)), MANY_NAMES)
    assert len(SegmentationDetector(MANY, errors=errors).detect(alone, ["cup"])) == 1


def test_edges_are_off_by_as_much_as_they_should_be() -> None:
    """Each edge moves by a draw of its own, and the mask fills the box that results as it filled the true one."""
    detector = SegmentationDetector(MANY, errors=DetectionErrors(jitter=2.0), seed=1)
    moved = []
    for _ in range(200):
        for d in detector.detect(many(), ASKED):
            assert d.mask is not None
            left, top, right, bottom = d.box
            assert d.mask[top:bottom, left:right].all()
            assert d.mask.sum() == (right - left) * (bottom - top)
            k = round((d.box[[0, 2]].mean() - 10) / 20)
            moved.append(d.box[[0, 2]] - [20 * k + 2, 20 * k + 18])
    inner = np.array(moved)
    assert abs(inner.mean()) < 0.2
    assert abs(np.std(inner) - np.sqrt(4.0 + 1 / 12)) < 0.25  # whole pixels add a twelfth to the variance


def test_mistakes_follow_from_the_seed_and_the_order_of_pictures() -> None:
    """The same seed makes the same ones, another seed others, and two pictures in a row have different ones."""

    def said(seed: int) -> list[list[tuple[str, list[int]]]]:
        detector = SegmentationDetector(MANY, errors=DetectionErrors(0.3, 0.3, 2.0), seed=seed)
        return [[(d.phrase, d.box.tolist()) for d in detector.detect(many(), ASKED)] for _ in range(3)]

    assert said(1) == said(1)
    assert said(1) != said(2)
    assert said(1)[0] != said(1)[1]


def test_what_is_missed_does_not_depend_on_what_is_asked_for() -> None:
    """Asking for more things in a picture does not change which are missed and where the others are drawn."""
    errors = DetectionErrors(miss=0.5, jitter=2.0)
    few = SegmentationDetector(MANY, errors=errors).detect(many(), ["cup"])
    all_ = SegmentationDetector(MANY, errors=errors).detect(many(), ASKED)
    assert [d.box.tolist() for d in few] == [d.box.tolist() for d in all_ if d.phrase == "cup"]


def test_the_robot_is_never_mistaken() -> None:
    """Where its own parts are a robot knows from its joints: the errors leave them alone."""
    detector = SegmentationDetector(VOCABULARY, 1, DetectionErrors(1.0, 1.0, 5.0))
    (found,) = detector.detect(picture(LABELS), [ROBOT, "can of soda"])
    np.testing.assert_array_equal(found.mask, np.array(LABELS) >= 4)


@given(st.floats(0, 1), st.floats(0, 1), st.floats(0, 50))
def test_an_address_is_read_as_it_is_written(miss: float, confuse: float, jitter: float) -> None:
    """What is off may be left out; the order does not matter."""
    sizes = {"miss": miss, "confuse": confuse, "jitter": jitter}
    written = ", ".join(f"{name} = {size!r}" for name, size in reversed(sizes.items()) if size)
    assert DetectionErrors.read(written, "x") == DetectionErrors(**sizes)


@pytest.mark.parametrize(
    ("address", "says"),
    [
        ("mis=0.1", "unknown mistake 'mis'. Did you mean 'miss'?"),
        ("miss", "'miss' is not NAME=SIZE"),
        ("miss=0.1,", "'' is not NAME=SIZE"),
        ("miss=often", "miss=often is no number"),
        ("miss=1.5", "miss is 0 to 1, not 1.5"),
        ("jitter=-1", "jitter is 0 to 50, not -1"),
        ("confuse=nan", "confuse is 0 to 1, not nan"),
        ("miss=0.1,miss=0.2", "miss is given twice"),
    ],
)
def test_an_address_that_makes_no_sense_is_refused(address: str, says: str) -> None:
    """With what was given, what would be valid, and the nearest name."""
    with pytest.raises((UserError, UnknownName)) as caught:
        DetectionErrors.read(address, "detector segmentation")
    assert says in str(caught.value)
    assert "detector segmentation" in str(caught.value)


def test_a_run_that_goes_on_has_the_mistakes_that_it_would_have_had() -> None:
    """What was saved after some pictures, through the guard, says which mistakes come next."""
    errors = DetectionErrors(0.3, 0.3, 2.0)
    whole, stopped, later = (GuardedDetector(SegmentationDetector(MANY, errors=errors, seed=5)) for _ in range(3))
    for _ in range(7):
        whole.detect(many(), ASKED)
        stopped.detect(many(), ASKED)
    later.restore(json.loads(json.dumps(stopped.save())))
    told = [[(d.phrase, d.score, *d.box.tolist()) for d in one.detect(many(), ASKED)] for one in (whole, later)]
    assert told[0] == told[1]
    for spoilt in ({}, {"pictures": "many"}, {"pictures": None}):
        with pytest.raises((KeyError, TypeError, ValueError)):
            later.restore(spoilt)
