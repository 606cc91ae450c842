"""Eyes that see kinds in pictures: one pass for all who look, words by kind, and never a label of the renderer."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection

import numpy as np
import pytest
from numpy.typing import NDArray

from mpvi_bt.finding.perception.color_patches import patches
from mpvi_bt.finding.perception.detector import ROBOT, GuardedDetector
from mpvi_bt.finding.perception.learned_checker import LearnedChecker
from mpvi_bt.finding.perception.learned_detector import LearnedDetector
from mpvi_bt.finding.perception.segmentation import SegmentationDetector
from mpvi_bt.finding.perception.segments import FLOOR, SWITCHES, Segments, kind_of
from mpvi_bt.finding.perception.shared_eyes import Eyes
from mpvi_bt.finding.perception.visual_checker import VisualChecker
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.ground.words.phrases import Vocabulary
from mpvi_bt.house.layout.house import load_house
from mpvi_bt.house.things.catalogue import load_catalogue
from mpvi_bt.house.things.kind_words import kind_sizes, kind_words
from mpvi_bt.runs.choices.backends import eyes_of
from mpvi_bt.testing import LabelSegmenter, check_checker, check_detector
from tests.small_house import placed, small_world
from tests.test_checkers import Box, can, fingers, head, trash_can, wrist

WORDS = kind_words(load_catalogue())
KINDS = (*WORDS, SWITCHES, ROBOT)
SODA, BIN, RADIO = "can__of__soda.n.01", "ashcan.n.01", "radio_receiver.n.01"


def eyes() -> Eyes:
    return Eyes(LabelSegmenter(KINDS), WORDS)


def picture(labels: object, names: dict[int, str]) -> CameraImage:
    array = np.array(labels, np.int32)
    rgb = np.zeros((*array.shape, 3), np.uint8)
    return CameraImage("head", rgb, np.ones(array.shape, np.float32), array, names, np.eye(3), np.eye(4))


CANS = picture(
    [[0, 1, 1, 4], [2, 0, 3, 5], [2, 6, 3, 7]],
    {1: f"{SODA}_1", 2: f"{SODA}_2", 3: f"{BIN}_1", 4: ROBOT, 5: ROBOT, 6: "floor_kitchen", 7: "kitchen_window_1"},
)
VOCABULARY = {f"{SODA}_1": WORDS[SODA], f"{SODA}_2": WORDS[SODA], f"{BIN}_1": WORDS[BIN]}
ASKED = ["can of soda", "the soda cans on the table", "garbage can", "elephant", "window", "floor", ROBOT]


def in_bin(z: float) -> list[Box]:
    """Two cans at a height over the bin's floor, called as the world calls such things."""
    boxes = [*trash_can(), can(0.03, 0.0, z), can(-0.03, 0.05, z, "can_2"), ("floor", (-3, -3, -0.1), (3, 3, 0.0))]
    called = {"bin": f"{BIN}_1", "can_1": f"{SODA}_1", "can_2": f"{SODA}_2", "floor": "floor_1"}
    return [(called[name], low, high) for name, low, high in boxes]


def test_it_keeps_the_contracts_of_detectors_and_checkers() -> None:
    """Bare, guarded and near."""
    check_detector(lambda: LearnedDetector(eyes()), [CANS, head(in_bin(0.02))], ASKED)
    check_detector(lambda: GuardedDetector(LearnedDetector(eyes())).near, [CANS], ASKED)
    check_checker(LearnedChecker(eyes()))


def test_perfect_segments_are_found_as_labels_are() -> None:
    """With identities taken off, the same masks and boxes are found for the same phrases."""
    for image in (CANS, head(in_bin(0.02))):
        by_labels = SegmentationDetector(VOCABULARY, least_px=1).detect(image, [*ASKED[:4], ROBOT])
        by_kinds = LearnedDetector(eyes(), least_px=1).detect(image, [*ASKED[:4], ROBOT])
        assert len(by_kinds) == len(by_labels) > 0
        for own, other in zip(by_kinds, by_labels, strict=True):
            assert (own.phrase, own.score) == (other.phrase, other.score)
            np.testing.assert_array_equal(own.mask, other.mask)
            np.testing.assert_array_equal(own.box, other.box)


def test_what_no_kind_is_called_is_not_found() -> None:
    """Nor is background: that a thing is there does not make it known."""
    detector = LearnedDetector(eyes(), least_px=1)
    assert detector.detect(CANS, ["elephant", "window", "", "the", SODA, f"{SODA}_1", "kitchen_window_1"]) == []
    assert detector.detect(dataclasses.replace(CANS, rgb=CANS.rgb.copy(), labels=None), ASKED) == []


def test_a_phrase_means_a_kind_by_any_of_its_words() -> None:
    """Synonyms, plurals, qualities and parts count as with any vocabulary."""
    seeing = eyes()
    assert seeing.meant("two of your soda cans") == {SODA}
    assert seeing.meant("the refrigerator's left door in the kitchen") == {"electric_refrigerator"}
    assert seeing.meant("the switch of the radio") == {f"{RADIO}.switch"}
    assert seeing.meant(ROBOT) == {ROBOT}
    assert seeing.meant("elephant") == set()


@pytest.mark.parametrize("house", ["family_house", "generated:3", "generated:flat:3", "generated:office:3"])
def test_words_of_a_kind_are_those_of_its_things(house: str) -> None:
    """Whatever a fixture of a house, or a thing of the catalogue, is called means its kind, too."""
    vocabulary = Vocabulary(WORDS)
    called = [(kind_of(name), fixture.entry) for name, fixture in load_house(house).fixtures.items()]
    called += [(kind_of(f"{e.synset}_1"), e) for e in load_catalogue() if e.mass_kg is not None]
    for kind, entry in called:
        for phrase in entry.phrases if kind else ():
            assert kind in vocabulary.named(phrase), (kind, phrase)


def test_all_who_look_at_a_picture_share_one_pass() -> None:
    """Detector, the one for hands and checker; also where one of them has smoothed the depth."""
    segmenter = LabelSegmenter(KINDS)
    seeing = Eyes(segmenter, WORDS)
    detector, checker = LearnedDetector(seeing), LearnedChecker(seeing)
    detector.detect(CANS, ASKED)
    detector.near.detect(dataclasses.replace(CANS, depth=CANS.depth + 1), ASKED)
    checker.check("a can of soda is in the trash can", CANS)
    assert segmenter.passes == 1
    detector.detect(dataclasses.replace(CANS, rgb=CANS.rgb.copy()), ASKED)
    assert segmenter.passes == 2


def test_a_thing_of_few_pixels_is_seen_by_the_near_one_alone() -> None:
    """The least size is of detectors that place things from afar; of the robot every pixel counts."""
    detector = LearnedDetector(eyes())
    assert [d.phrase for d in detector.detect(CANS, ["can of soda", ROBOT])] == [ROBOT]
    assert [d.phrase for d in detector.near.detect(CANS, ["can of soda", ROBOT])] == [*["can of soda"] * 2, ROBOT]
    errs = SegmentationDetector(VOCABULARY)
    assert (len(errs.detect(CANS, ["can of soda"])), len(errs.near.detect(CANS, ["can of soda"]))) == (0, 2)


def test_a_switch_is_of_the_thing_that_it_is_on() -> None:
    """The network knows switches, not whose they are: that is what borders on them most."""
    labels = np.zeros((12, 24), int)
    labels[1:11, 1:11], labels[4:6, 4:7] = 1, 2
    labels[1:11, 13:23], labels[8:10, 15:17] = 3, 4
    names = {1: f"{RADIO}_1", 2: f"{RADIO}_1.switch", 3: "oven_1", 4: "oven_1.switch"}
    detector = LearnedDetector(eyes(), least_px=1)
    for phrase, label in (("switch of the radio", 2), ("switch of the oven", 4)):
        (found,) = detector.detect(picture(labels, names), [phrase])
        np.testing.assert_array_equal(found.mask, labels == label)


class Hidden:
    """A network whose second segment has no pixel left, as the first one lies over it."""

    kinds: tuple[str, ...] = (RADIO, SWITCHES)

    def segment(self, image: CameraImage) -> Segments:
        return Segments(np.ones(image.depth.shape, np.int32), self.kinds, np.ones(2))


def test_a_segment_without_pixels_is_nothing() -> None:
    """Neither a thing nor a switch."""
    found = LearnedDetector(Eyes(Hidden(), WORDS), least_px=1).detect(CANS, ["radio", "switch of the radio"])
    assert [d.phrase for d in found] == ["radio"]


class Doubting:
    """A network that is not sure: it takes the left half for a can, and the right one for a bin."""

    kinds: tuple[str, ...] = (SODA, BIN)

    def segment(self, image: CameraImage) -> Segments:
        labels = np.ones(image.depth.shape, np.int32)
        labels[:, image.depth.shape[1] // 2 :] = 2
        return Segments(labels, self.kinds, np.array([0.6, 0.4]))


def test_scores_are_the_networks() -> None:
    """How sure the network is of a kind is the score. Hands and checkers are told only what is likely."""
    detector = LearnedDetector(Eyes(Doubting(), WORDS), least_px=1)
    found = detector.detect(CANS, ["can of soda", "trash can"])
    assert [(d.phrase, d.score) for d in found] == [("can of soda", 0.6), ("trash can", 0.4)]
    assert [d.phrase for d in detector.near.detect(CANS, ["can of soda", "trash can"])] == ["can of soda"]
    judged = LearnedChecker(Eyes(Doubting(), WORDS)).check("the can of soda is in the trash can", head(in_bin(0.02)))
    assert judged.reason == "no trash can in the picture"


@dataclasses.dataclass(frozen=True, eq=False)
class Hopeful(Segments):
    """Segments that are surer of what is asked for, and take a known thing for a kind."""

    asked: list[set[str]]
    taken_for: str = ""
    sure: float = 0.9

    def expecting(self, kinds: Collection[str], outlines: NDArray[np.int32] | None = None) -> Segments:
        self.asked.append(set(kinds))
        scores = np.array(
            [0.9 if kind in kinds else score for kind, score in zip(self.kinds, self.scores, strict=True)]
        )
        if outlines is None or not outlines.any():
            return dataclasses.replace(self, scores=scores)
        count = int(outlines.max())
        labels = np.where(outlines > 0, len(self.kinds) + outlines, self.labels).astype(np.int32)
        return Segments(labels, (*self.kinds, *[self.taken_for] * count), np.append(scores, [self.sure] * count))


class Hoping(LabelSegmenter):
    """By the labels, with doubts; what is between the fingers is background."""

    def __init__(self, taken_for: str = "", sure: float = 0.9, score: float = 0.4) -> None:
        super().__init__(KINDS)
        self.asked: list[set[str]] = []
        self._taken_for, self._sure, self._score = taken_for, sure, score

    def segment(self, image: CameraImage) -> Segments:
        seen = super().segment(image)
        return Hopeful(seen.labels, seen.kinds, seen.scores * self._score, self.asked, self._taken_for, self._sure)


def test_hands_and_checkers_expect_what_they_ask_for_and_a_search_does_not() -> None:
    """So they are surer of it; and of nothing else."""
    segmenter = Hoping()
    seeing = Eyes(segmenter, WORDS)
    far = LearnedDetector(seeing, least_px=1)
    assert {d.score for d in far.detect(CANS, ["can of soda"])} == {0.4}
    assert segmenter.asked == []
    assert {d.score for d in far.near.detect(CANS, ["can of soda"])} == {0.9}
    assert far.near.detect(CANS, ["trash can", "elephant"])[0].score == 0.9
    LearnedChecker(seeing).check("a can of soda is in the trash can", CANS)
    assert segmenter.asked == [{SODA}, {BIN}, {SODA, BIN}]
    assert segmenter.passes == 1


def test_a_thing_is_not_next_to_a_piece_of_itself() -> None:
    """One can of which two segments are seen, flush with each other, is no can next to another can."""
    floor: Box = ("floor_1", (-3, -3, -0.1), (3, 3, 0.0))
    left: Box = (f"{SODA}_1", (-0.1, -0.1, 0.0), (0.1, 0.0, 0.2))
    halves: list[Box] = [floor, left, (f"{SODA}_2", (-0.1, 0.0, 0.0), (0.1, 0.1, 0.2))]
    apart: list[Box] = [floor, left, (f"{SODA}_2", (-0.1, 0.04, 0.0), (0.1, 0.14, 0.2))]
    criterion = "a can of soda is next to another can of soda"
    assert not LearnedChecker(eyes()).check(criterion, head(halves)).complete
    assert LearnedChecker(eyes()).check(criterion, head(apart)).complete


def test_pieces_of_one_thing_are_one_thing() -> None:
    """What an arm parts in the picture is one thing, if it is together no larger than one such thing is."""
    sizes = {SODA: 0.15}
    arm: Box = ("robot", (-0.3, -0.01, 0.3), (0.3, 0.01, 0.4))
    for shift, count in ((0.0, 1), (0.1, 2)):
        image = head([arm, (f"{SODA}_1", (-0.03, -0.05, 0.0), (0.03, 0.0, 0.1)),
                      (f"{SODA}_2", (-0.03, shift, 0.0), (0.03, 0.05 + shift, 0.1))])  # fmt: skip
        found = LearnedDetector(Eyes(LabelSegmenter(KINDS), WORDS, sizes), least_px=1).detect(image, ["can of soda"])
        assert len(found) == count
        assert len(LearnedDetector(eyes(), least_px=1).detect(image, ["can of soda"])) == 2
        assert image.labels is not None
        masks = [d.mask for d in found if d.mask is not None]
        assert sum(np.count_nonzero(mask) for mask in masks) == np.isin(image.labels, [1, 2]).sum()
        doubting = Eyes(Hoping(score=0.4), WORDS, sizes)  # what is not sure is no piece of anything
        assert len(LearnedDetector(doubting, least_px=1).detect(image, ["can of soda"])) == 2


def test_a_switch_on_a_piece_is_on_the_whole() -> None:
    """Whichever piece of a radio it is seen on, and whatever that would be called alone."""
    labels = np.zeros((30, 60), int)
    labels[5:25, 5:30], labels[5:25, 34:50], labels[10:14, 40:44] = 1, 2, 3
    image = picture(labels, {1: f"{RADIO}_1", 2: f"{RADIO}_2", 3: f"{RADIO}_2.switch"})
    small = dataclasses.replace(image, K=np.diag([400.0, 400.0, 1.0]))
    seen, things = Eyes(LabelSegmenter(KINDS), WORDS, {RADIO: 0.3}).see(small)
    assert sorted(set(seen.names.values())) == [f"{RADIO}_1", f"{RADIO}_1.switch"]
    assert len(things) == 3


def test_a_patch_of_color_may_be_what_is_missing() -> None:
    """A light on a radio is its switch, if the network takes it for one when it looks at that alone; and surely."""
    labels, rgb = np.zeros((30, 40), np.int32), np.full((30, 40, 3), 60, np.uint8)
    labels[5:25, 5:35], rgb[8:12, 10:14] = 1, (30, 220, 60)
    image = dataclasses.replace(picture(labels, {1: f"{RADIO}_1"}), rgb=rgb)
    for taken_for, sure, seen in ((SWITCHES, 0.9, 16), (SWITCHES, 0.4, 0), (SODA, 0.9, 0)):
        seeing = Eyes(Hoping(taken_for, sure), WORDS, {RADIO: 0.3})
        found = LearnedDetector(seeing, least_px=1).near.detect(image, ["radio", "switch of the radio"])
        assert sum(d.mask.sum() for d in found if d.mask is not None and d.phrase != "radio") == seen
        assert sum(d.mask.sum() for d in found if d.mask is not None) == 600
        judged = LearnedChecker(seeing).check("the radio is turned on", image)
        assert judged.complete == (seen > 0)
    unknown = Eyes(Hoping(SWITCHES), WORDS)  # nobody knows how large a radio is: it may be furniture
    assert not LearnedDetector(unknown, least_px=1).near.detect(image, ["switch of the radio"])


def test_patches_are_what_has_a_color_of_its_own() -> None:
    """The faces of a thing are none; a hole in it is; the largest is the first."""
    rgb, thing = np.full((40, 40, 3), 90, np.uint8), np.zeros((40, 40), bool)
    thing[4:36, 4:36] = True
    rgb[:20] = 120  # two faces
    assert not patches(rgb, thing).any()
    rgb[8:11, 8:11], rgb[24:30, 20:26] = (200, 30, 30), (30, 200, 30)
    found = patches(rgb, thing)
    assert (found[8:11, 8:11] == 2).all()
    assert (found[24:30, 20:26] == 1).all()
    assert np.count_nonzero(found) == 9 + 36
    thing[24:30, 20:26] = False
    assert (patches(rgb, thing) == found).all()
    assert not patches(rgb, np.zeros_like(thing)).any()


def test_sizes_of_kinds_are_those_of_the_catalogue() -> None:
    """Of all that can be carried, and of it alone: a can of soda is 12 cm high and 6 to 7 cm thick."""
    sizes = kind_sizes(load_catalogue())
    assert 0.12 < sizes[SODA] < 0.17
    assert set(sizes) <= set(WORDS)
    assert "sofa" not in sizes


HELD: list[Box] = [("wall_1", (-0.03, -0.02, 0.13), (0.03, 0.02, 0.25)), ("floor_1", (-2, -2, 0.6), (2, 2, 1))]


@pytest.mark.parametrize(
    ("taken_for", "sure", "complete"), [(SODA, 0.9, True), (SODA, 0.4, False), (BIN, 0.9, False), (FLOOR, 0.4, False)]
)
def test_what_is_between_the_fingers_is_looked_at_as_one_thing(taken_for: str, sure: float, complete: bool) -> None:
    """If it is taken for what is asked for, and surely, that is held."""
    checker = LearnedChecker(Eyes(Hoping(taken_for, sure), WORDS))
    image = wrist([*fingers(0.04), *HELD])
    assert checker.check("the can of soda is held in a gripper", image).complete is complete
    assert checker.check("the can of soda is held in the right gripper", image).complete is complete
    assert not checker.check("the can of soda is held in the left gripper", image).complete
    assert not checker.check("the can of soda is held in a gripper", wrist([*fingers(0.04), HELD[1]])).complete


def test_a_handle_is_a_part_of_what_it_is_seen_before() -> None:
    """Nobody knows a bail by itself: between the fingers and before a bin it is the bin's."""
    bail: Box = ("wall_1", (-0.3, -0.015, 0.13), (0.01, 0.015, 0.16))
    bottom: Box = (f"{BIN}_1", (-0.4, -0.4, 0.5), (0.4, 0.4, 0.52))
    checker = LearnedChecker(Eyes(Hoping(FLOOR, 0.2), WORDS))
    judged = checker.check("the trash can is held in a gripper", wrist([*fingers(0.03), bail, bottom]))
    assert (judged.complete, judged.reason) == (True, "a part of trash can is seen between the fingers")
    assert not checker.check("the can of soda is held in a gripper", wrist([*fingers(0.03), bail, bottom])).complete
    assert not checker.check("the trash can is held in a gripper", wrist([*fingers(0.03), bottom])).complete
    surely = LearnedChecker(Eyes(Hoping(SODA, 0.9), WORDS))
    assert not surely.check("the trash can is held in a gripper", wrist([*fingers(0.03), bail, bottom])).complete


@pytest.mark.parametrize("z", [0.02, 0.35])
@pytest.mark.parametrize(
    "criterion",
    [
        "a can of soda is in the trash can", "two cans of soda are in the trash can", "the can of soda is on the floor",
        "the robot is at the trash can", "the can of soda is held in a gripper", "the trash can is on the floor",
        "the elephant is in the trash can", "nonsense",
    ],
)  # fmt: skip
def test_it_judges_as_the_visual_checker_does(criterion: str, z: float) -> None:
    """By the same rules: with perfect segments the answers are the same."""
    floors = ("floor", "kitchen floor")
    image = head(in_bin(z))
    judged = LearnedChecker(eyes(), floors).check(criterion, image)
    assert judged == VisualChecker({**VOCABULARY, "floor_1": floors}).check(criterion, image)


def test_without_a_picture_the_answer_is_no() -> None:
    """With that as the reason; and a picture without labels is enough to look at."""
    assert LearnedChecker(eyes()).check("a can of soda is in the trash can", None).reason == "no picture to look at"
    judged = LearnedChecker(Eyes(Doubting(), WORDS)).check("the can of soda is in the trash can", head(in_bin(0.02)))
    assert judged.reason != "no labeled picture to look at"


def test_background_has_no_words() -> None:
    """What no skill asks for is of no kind, so it is called nothing."""
    assert "" not in WORDS
    assert WORDS[FLOOR] == ("floor",)
    assert "table" not in WORDS["desk"]


# ------------------------------------------------------------------------------- who reads the renderer's labels


@pytest.mark.parametrize(
    ("chosen", "eyes"),
    [
        (("segmentation", "reactive", "visual"), ("labels", "labels", "labels")),
        (("segmentation:miss=0.1", "learned", "oracle"), ("labels", "labels", "")),
        (("grounding_dino", "reactive", "openai:m"), ("pixels", "pixels", "pixels")),
        (("grounding_dino", "learned[pick]+reactive", "visual:fp=0.1"), ("pixels", "pixels", "labels")),
        (("grounding_dino", "learned+expert", "oracle"), ("pixels", "pixels", "")),
        (("oracle", "reactive", "oracle"), ("", "labels", "")),
        (("oracle", "expert", "oracle"), ("", "", "")),
        (("oracle", "openpi:ws://localhost:8000", "oracle"), ("", "pixels", "")),
    ],
)
def test_each_part_sees_by_labels_or_by_pixels(chosen: tuple[str, ...], eyes: tuple[str, ...]) -> None:
    """Policies that run here see as the detector does."""
    kinds = ("detector", "policy", "checker")
    known = eyes_of(dict(zip(kinds, chosen, strict=True)))
    assert known == {kind: by for kind, by in zip(kinds, eyes, strict=True) if by}


@pytest.mark.render
def test_a_camera_that_is_told_to_shows_no_labels() -> None:
    """Colors, depth and pose stay the same; there are neither labels nor names of things."""
    world = small_world({"can": placed("can_of_soda", 1.0, 0.0)}, render=True)
    world.settle()
    assert world.cameras is not None
    with_labels = world.robot.look("head")
    world.cameras.labels = False
    without = world.robot.look("head")
    assert with_labels.labels is not None
    assert (without.labels, dict(without.names)) == (None, {})
    np.testing.assert_array_equal(without.depth, with_labels.depth)
    np.testing.assert_array_equal(without.rgb, with_labels.rgb)
