"""The guard around detectors: whatever goes wrong in one is an error with a reason, and nothing hangs."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mpvi_bt
from mpvi_bt.finding.perception.detector import Detection, GuardedDetector
from mpvi_bt.ground.errors import DetectorError
from mpvi_bt.ground.robot.protocol import CameraImage
from mpvi_bt.testing import KinematicRobot, check_detector

IMAGE = KinematicRobot().look("head")
HEIGHT, WIDTH = IMAGE.depth.shape
BOX = np.array([1, 1, 4, 5])
MASK = np.zeros((HEIGHT, WIDTH), bool)
MASK[1:5, 1:4] = True


class Saying:
    """A detector that answers, raises or waits as it is told; by default it sees a cup in every picture."""

    name = "saying"

    def __init__(self, answer: Callable[[Sequence[str]], Any] | None = None) -> None:
        self._answer = answer or self._cup

    @staticmethod
    def _cup(phrases: Sequence[str]) -> list[Detection]:
        return [Detection("cup", 0.9, BOX.copy(), MASK.copy())] if "cup" in phrases else []

    def detect(self, image: CameraImage, phrases: Sequence[str]) -> list[Detection]:
        return self._answer(phrases)


def fails(answer: Callable[[Sequence[str]], Any], limit_s: float = 5.0) -> DetectorError:
    with pytest.raises(DetectorError) as caught:
        GuardedDetector(Saying(answer), limit_s).detect(IMAGE, ["cup"])
    return caught.value


def test_what_a_good_detector_finds_goes_through() -> None:
    """The guard takes nothing away, adds nothing, and keeps the contract and the name."""
    guarded = GuardedDetector(Saying())
    check_detector(lambda: GuardedDetector(Saying()), [IMAGE], ["cup", "bowl"])
    assert (guarded.name, guarded.note) == ("saying", "")
    (found,) = guarded.detect(IMAGE, ["cup"])
    np.testing.assert_array_equal(found.box, BOX)
    (found,) = GuardedDetector(Saying(lambda _: (Detection("cup", 1, BOX),))).detect(IMAGE, ["cup"])
    assert found.mask is None


def _raise(error: BaseException) -> Callable[[Sequence[str]], Any]:
    def answer(_: Sequence[str]) -> Any:
        raise error

    return answer


@pytest.mark.parametrize("error", [ValueError("no cup"), RecursionError(), MemoryError(), SystemExit(3)])
def test_what_a_detector_raises_is_a_reason(error: BaseException) -> None:
    """Whatever its kind, and with what it said."""
    caught = fails(_raise(error))
    assert caught.reason == "raised"
    assert type(error).__name__ in str(caught)
    assert str(error) in str(caught)
    assert caught.__cause__ is error


def test_a_reason_that_a_detector_gives_itself_stays() -> None:
    """Its own word is not wrapped into another."""
    assert fails(_raise(DetectorError("not_loaded", "no weights"))).reason == "not_loaded"


def cup(**changed: Any) -> Callable[[Sequence[str]], Any]:
    given: dict[str, Any] = {"phrase": "cup", "score": 0.5, "box": BOX, "mask": MASK} | changed
    return lambda _: [Detection(**given)]


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        (lambda _: None, "bad_answer"),
        (lambda _: {"cup": BOX}, "bad_answer"),
        (lambda _: ["cup"], "bad_answer"),
        (lambda _: [Detection("cup", 0.5, BOX)] * 20_000, "bad_answer"),
        (cup(phrase="bowl"), "bad_phrase"),
        (cup(phrase=None), "bad_phrase"),
        (cup(score=np.nan), "bad_score"),
        (cup(score=1.2), "bad_score"),
        (cup(score=-0.1), "bad_score"),
        (cup(score="high"), "bad_score"),
        (cup(score=np.array([0.5, 0.6])), "bad_score"),
        (cup(box=np.array([-1, 0, 4, 5])), "bad_box"),
        (cup(box=np.array([0, 0, WIDTH + 1, 5])), "bad_box"),
        (cup(box=np.array([0, 0, 4, HEIGHT + 1])), "bad_box"),
        (cup(box=np.array([4, 1, 4, 5])), "bad_box"),
        (cup(box=np.array([4, 1, 1, 5])), "bad_box"),
        (cup(box=np.array([1, 1, 4])), "bad_box"),
        (cup(box=np.array([1.5, 1, 4, 5])), "bad_box"),
        (cup(box=np.array([np.nan, 1, 4, 5])), "bad_box"),
        (cup(box=None), "bad_box"),
        (cup(box=[[1], [2, 3]]), "bad_box"),
        (cup(mask=MASK[:-1]), "bad_mask"),
        (cup(mask=MASK.T if HEIGHT != WIDTH else MASK[0]), "bad_mask"),
        (cup(mask=MASK.astype(float)), "bad_mask"),
        (cup(mask=np.zeros_like(MASK)), "bad_mask"),
        (cup(mask=[True]), "bad_mask"),
    ],
)  # fmt: skip
def test_what_is_no_detection_is_refused(answer: Callable[[Sequence[str]], Any], reason: str) -> None:
    """Each kind of nonsense has its reason, and the message names the detector."""
    error = fails(answer)
    assert error.reason == reason
    assert "detector saying" in str(error)


def test_a_detector_that_hangs_is_left_alone_until_it_comes_back() -> None:
    """The wait is bounded, the next call is refused at once, and what comes too late is thrown away."""
    free = threading.Event()
    answers = iter([lambda: (free.wait(20), [Detection("cup", 0.1, BOX)])[1], lambda: [Detection("cup", 0.2, BOX)]])
    guarded = GuardedDetector(Saying(lambda _: next(answers)()), limit_s=0.2)
    started = time.monotonic()
    for _ in range(3):
        with pytest.raises(DetectorError) as caught:
            guarded.detect(IMAGE, ["cup"])
        assert caught.value.reason == "hangs"
    assert time.monotonic() - started < 5.0
    free.set()
    deadline = time.monotonic() + 10
    while True:
        try:
            (found,) = guarded.detect(IMAGE, ["cup"])
            break
        except DetectorError:
            assert time.monotonic() < deadline
    assert found.score == 0.2


def _blackens(self: Any, image: CameraImage, phrases: Sequence[str]) -> list[Detection]:
    image.rgb[:] = 0
    return []


def _counts(self: Any, image: CameraImage, phrases: Sequence[str]) -> list[Detection]:
    type(self).seen = getattr(type(self), "seen", 0) + 1
    return [Detection("cup", 1 / type(self).seen, BOX.copy())] if "cup" in phrases else []


def _keeps(self: Any, image: CameraImage, phrases: Sequence[str]) -> list[Detection]:
    self.box = getattr(self, "box", BOX.copy())
    return [Detection("cup", 1.0, self.box)] if "cup" in phrases else []


BREAKS: list[tuple[str, Callable[..., Any], str]] = [
    ("raises", lambda *_: 1 / 0, "detect raised for"),
    ("answers_no_list", lambda *_: None, "detect must give a list"),
    ("finds_what_is_not_asked", lambda *_: [Detection("elephant", 1.0, BOX)], "'elephant' was not asked for"),
    ("finds_nothing_by_name", lambda _, i, p: [Detection(p[0], 1.0, BOX)] if p else [], "must find nothing"),
    ("changes_the_picture", _blackens, "a picture is not to be changed"),
    ("is_not_the_same_twice", _counts, "equal detectors must find the same"),
    ("gives_its_own_away", _keeps, "is empty or not within"),
    ("has_no_name", Saying.detect, "a detector has a name"),
]


@pytest.mark.parametrize(("what", "detect", "says"), BREAKS, ids=[what for what, _, _ in BREAKS])
def test_what_breaks_the_contract_is_told(what: str, detect: Callable[..., Any], says: str) -> None:
    """Each clause of the check can fail, and says which it is."""
    kind = type("Broken", (Saying,), {"detect": detect, "name": "" if what == "has_no_name" else "broken"})
    image = replace(IMAGE, rgb=np.full_like(IMAGE.rgb, 9))
    with pytest.raises(AssertionError, match=says):
        check_detector(kind, [image], ["cup"])


def test_every_reason_is_in_the_page() -> None:
    """docs/detectors.md lists what the source says, and nothing else."""
    package = Path(mpvi_bt.__file__).parent
    page = (package.parent / "docs" / "detectors.md").read_text(encoding="utf-8")
    source = "".join(path.read_text(encoding="utf-8") for path in (package / "finding" / "perception").glob("*.py"))
    said = set(re.findall(r'DetectorError\(\s*"([a-z_]+)"', source)) | set(re.findall(r'"(bad_[a-z]+)"', source))
    assert said == set(re.findall(r"^\| `([a-z_]+)` \|", page.split("## When a detector fails")[1], re.MULTILINE))
